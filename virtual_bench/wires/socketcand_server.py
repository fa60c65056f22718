"""A CAN bus served over TCP as socketcand does it, in raw mode: every client sees the frames of all others.

The protocol is text in angle brackets: `< hi >`, `< open CHANNEL >`, `< rawmode >`, `< send ID LEN B B ... >` and
`< frame ID SECONDS HEX >`. Frames for a client are gathered and written once per pass of the event loop.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import cast

from virtual_bench.wires.hang_up import hang_up

BACKLOG_BYTES = 256 * 1024  # a client that reads nothing loses frames beyond this, as a full CAN queue would
QUIET_S = 0.05  # python-can takes whatever follows `< ok >` in one packet for a wrong answer
MAX_COMMAND_BYTES = 4096

EXTENDED = 0x80000000
"""Mark of an identifier of 29 bits, as in Linux (`CAN_EFF_FLAG`): of 29 bits 0x205 is another frame than of 11."""

SHORT_IDENTIFIER_DIGITS = 3
Frame = tuple[int, bytes]
Listener = Callable[[int, bytes], None]


class SocketcandServer:
    """One channel with its clients. `on_frame` gets what clients send; `send` is the local node's way out."""

    def __init__(self, channel: str, on_frame: Listener, log: Callable[[str, str], None]) -> None:
        self.channel = channel
        self._on_frame = on_frame
        self._log = log
        self._clients: set[SocketcandClient] = set()
        self._server: asyncio.Server | None = None
        self.frames_sent = 0
        self.clock_offset_s = 0.0  # of the time stamps: a clock that was set in the middle of it

    async def start(self, host: str, port: int) -> int:
        """Listen and return the port; port 0 takes a free one. Raises `OSError` when it cannot be had."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: SocketcandClient(self), host, port)
        return int(self._server.sockets[0].getsockname()[1])

    async def stop(self) -> None:
        """Close the port and all connections."""
        if self._server is not None:
            self._server.close()
        self.cut()

    def cut(self) -> None:
        """Drop all connections, as an adapter that is unplugged does."""
        for client in list(self._clients):
            client.close()

    @property
    def connected(self) -> bool:
        """Whether frames of a client can come."""
        return bool(self._clients)

    def flush(self) -> None:
        """Write what is gathered now."""
        for client in self._clients:
            client.flush()

    def send(self, cob_id: int, data: bytes) -> None:
        """Put a frame of the local node on the bus."""
        self.frames_sent += 1
        text = _frame_text(cob_id, data, self.clock_offset_s)
        for client in self._clients:
            client.queue(text)

    def send_error(self) -> None:
        """Report an error frame to all clients; socketcand tells no details of it."""
        self.frames_sent += 1
        text = b"< error 004 %.6f >" % (time.time() + self.clock_offset_s)
        for client in self._clients:
            client.queue(text)

    def joined(self, client: SocketcandClient) -> None:
        """Take a client that entered raw mode."""
        self._clients.add(client)
        self._log("can_client", f"client on {self.channel}: {client.peer}")

    def left(self, client: SocketcandClient) -> None:
        """Forget a client whose connection ended."""
        if client in self._clients:
            self._clients.remove(client)
            self._log("can_client_gone", f"client left {self.channel}: {client.peer}")

    def lost_frames(self, client: SocketcandClient) -> None:
        """Report a client that does not read."""
        self._log("can_overrun", f"client {client.peer} does not read: frames are lost")

    def received(self, sender: SocketcandClient, cob_id: int, data: bytes) -> None:
        """Pass a client's frame on to everybody else."""
        if len(self._clients) > 1:
            text = _frame_text(cob_id, data, self.clock_offset_s)
            for client in self._clients:
                if client is not sender:
                    client.queue(text)
        if not cob_id & EXTENDED:  # no device of the bench has identifiers of 29 bits
            self._on_frame(cob_id, data)


class SocketcandClient(asyncio.Protocol):
    """One connection."""

    def __init__(self, server: SocketcandServer) -> None:
        self._server = server
        self._buffer = b""
        self._raw = False
        self._out: list[bytes] = []
        self._quiet = True
        self._flush_due = False
        self._losing = False
        self.peer = ""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Greet; asyncio has switched Nagle's algorithm off already."""
        self._transport = cast("asyncio.Transport", transport)  # a TCP server makes no other
        self.peer = "{}:{}".format(*transport.get_extra_info("peername")[:2])
        self._transport.write(b"< hi >")

    def connection_lost(self, exc: Exception | None) -> None:
        """Leave the bus."""
        del exc
        self._server.left(self)

    def close(self) -> None:
        """End the connection."""
        hang_up(self._transport)

    def data_received(self, data: bytes) -> None:
        """Take commands; what is incomplete waits for the rest."""
        *commands, self._buffer = (self._buffer + data).split(b">")
        for command in commands:
            words = command.split()
            if len(words) >= 2 and words[0] == b"<":
                self._obey(words)
            else:
                self._refuse(command)
        if len(self._buffer) > MAX_COMMAND_BYTES:
            self._buffer = b""
            self._refuse(b"no end of command")

    def queue(self, text: bytes) -> None:
        """Have a frame written with the next flush."""
        if self._transport.get_write_buffer_size() > BACKLOG_BYTES:
            if not self._losing:
                self._losing = True
                self._server.lost_frames(self)
            return
        self._losing = False
        self._out.append(text)
        if not self._flush_due and not self._quiet:
            self._flush_due = True
            asyncio.get_running_loop().call_soon(self.flush)

    def flush(self) -> None:
        """Write what is gathered."""
        self._flush_due = False
        if self._out and not self._transport.is_closing():
            self._transport.write(b"".join(self._out))
        self._out.clear()

    def _obey(self, words: list[bytes]) -> None:
        verb = words[1]
        if self._raw:
            if self._quiet:
                self._end_quiet()
            if verb == b"send":
                self._take_frame(words)
            elif verb == b"echo":
                self._transport.write(b"< echo >")
            else:
                self._refuse(b" ".join(words[1:]))
        elif verb == b"open" and len(words) == 3:
            known = words[2] == self._server.channel.encode()
            self._transport.write(b"< ok >" if known else b"< error could not open bus >")
        elif verb == b"rawmode":
            self._raw = True
            self._transport.write(b"< ok >")
            self._server.joined(self)
            asyncio.get_running_loop().call_later(QUIET_S, self._end_quiet)
        else:
            self._refuse(b" ".join(words[1:]))

    def _end_quiet(self) -> None:
        """Frames may flow: the client has had the time to read the answer to `rawmode` alone."""
        self._quiet = False
        self.flush()

    def _take_frame(self, words: list[bytes]) -> None:
        try:
            cob_id, size = int(words[2], 16), int(words[3], 16)
            extended = len(words[2]) > SHORT_IDENTIFIER_DIGITS
            data = bytes([int(word, 16) for word in words[4:]])
        except (ValueError, IndexError):
            self._refuse(b" ".join(words[1:]))
            return
        if size > 8 or len(data) != size or not 0 <= cob_id <= 0x1FFFFFFF:
            self._refuse(b" ".join(words[1:]))
            return
        self._server.received(self, cob_id | EXTENDED if extended else cob_id, data)

    def _refuse(self, command: bytes) -> None:
        self._transport.write(b"< error unknown command " + command[:80].strip() + b" >")


def _frame_text(cob_id: int, data: bytes, clock_offset_s: float) -> bytes:
    identifier = b"%08X" % (cob_id ^ EXTENDED) if cob_id & EXTENDED else b"%03X" % cob_id
    return b"< frame %s %.6f %s >" % (identifier, time.time() + clock_offset_s, data.hex().upper().encode())
