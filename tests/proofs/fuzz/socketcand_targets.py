"""Both ends of the socketcand protocol as fuzz targets: our bus under the scan's link, and the virtual bus."""

from __future__ import annotations

import asyncio
import socket
from functools import cache

from fuzz_bench import SCANS, all_of, no_orders, the_config

from drivers.can.bus import CanLink
from drivers.can.socketcand_bus import SocketcandBus
from drivers.servo_drive.drive import CanDrive
from virtual_bench.wires.socketcand_server import SocketcandClient, SocketcandServer


def socketcand_client(data: bytes) -> None:
    """What a socketcand server sends: pieces of the length in their first byte, one per scan."""
    ours, theirs = socket.socketpair()
    bus = SocketcandBus(ours)
    link = CanLink(bus, the_config().can)
    drive = CanDrive(link, the_config().drive, 20)
    try:
        at = 0
        for scan in range(SCANS):
            size = data[at] if at < len(data) else 0
            theirs.send(data[at + 1 : at + 1 + size])
            at += 1 + size
            drive.poll(scan)
            drive.send(no_orders(), scan)
            all_of(drive, scan)
    finally:
        bus.shutdown()
        theirs.close()


class _Recorded(asyncio.Transport):
    """A connection that keeps what is written to it."""

    def __init__(self) -> None:
        super().__init__({"peername": ("127.0.0.1", 1)})
        self.sent: list[bytes] = []

    def write(self, data: bytes) -> None:  # type: ignore[override]
        self.sent.append(bytes(data))

    def get_write_buffer_size(self) -> int:
        return 0

    def is_closing(self) -> bool:
        return False


@cache
def _loop() -> asyncio.AbstractEventLoop:
    return asyncio.new_event_loop()


def socketcand_server(data: bytes) -> None:
    """What a client sends to the virtual bench's bus: pieces of the length in their first byte."""
    frames: list[tuple[int, bytes]] = []

    async def serve() -> None:
        server = SocketcandServer("vcan0", lambda cob_id, payload: frames.append((cob_id, payload)), lambda *_: None)
        client, other = SocketcandClient(server), SocketcandClient(server)
        client.connection_made(_Recorded())
        other.connection_made(_Recorded())
        other.data_received(b"< rawmode >")
        client.data_received(b"< open vcan0 >< rawmode >")
        at = 0
        while at < len(data):
            size = data[at]
            client.data_received(data[at + 1 : at + 1 + size])
            at += 1 + size
        client.connection_lost(None)

    _loop().run_until_complete(serve())
    assert all(0 <= cob_id <= 0x1FFF_FFFF and len(payload) <= 8 for cob_id, payload in frames)
