"""Modbus RTU lines of the virtual bench: devices with their own unit ids on one serial port, as on an RS-485 pair.

Requests are framed by pymodbus and answered by the same devices as on TCP. A device answers its own unit id only;
nobody answers another, nor a frame whose check sum is wrong.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU

from drivers.virtual.modbus_servers import ModbusServer
from drivers.virtual.pty_port import PtyPort

LONGEST_FRAME = 256
"""Bytes of the longest frame that the protocol allows."""

TCP_HEADER_BYTES = 6
"""Transaction, protocol and length, which RTU has not."""

GAP_S = 0.02
"""A piece of a frame that is not continued within this time is given up, as after a silence on a real line."""


class RtuLine:
    """One serial port with its devices."""

    def __init__(self, servers: list[ModbusServer], link: str, log: Callable[[str, str], None]) -> None:
        self._servers = {server.device.unit_id: server for server in servers}
        self._port = PtyPort(self._take, link)
        self._log = log
        self._framer = FramerRTU(DecodePDU(is_server=True))
        self._tcp = FramerSocket(DecodePDU(is_server=True))  # faults change frames of TCP
        self._buffer = b""
        self._gap: asyncio.TimerHandle | None = None

    async def start(self) -> str:
        """Make the serial port and return its path; raises `OSError` when it cannot be had."""
        return self._port.open()

    async def stop(self) -> None:
        """Pull the cable."""
        if self._gap is not None:
            self._gap.cancel()
        self._port.close()

    def _take(self, data: bytes) -> None:
        if self._gap is not None:
            self._gap.cancel()
            self._gap = None
        self._buffer += data
        try:
            used, request = self._framer.handleFrame(self._buffer, 0, 0)
        except ModbusException as error:  # a whole frame of a function that pymodbus does not know
            self._log("rtu_unknown", f"{self._port.path}: {error}")
            self._buffer = b""
            return
        if used:
            self._buffer = b""  # one request at a time: what follows it is noise
        elif self._buffer:
            self._gap = asyncio.get_running_loop().call_later(GAP_S, self._give_up)
        if request is not None and request.dev_id in self._servers:
            asked = self._tcp.buildFrame(request)
            self._servers[request.dev_id].answer(request, asked, self._tcp.buildFrame, self._reply)

    def _give_up(self) -> None:
        self._buffer = b""

    def _reply(self, response: bytes) -> None:
        """Send a response that faults have left as a frame of TCP; on this line it has a check sum and no header."""
        body = response[TCP_HEADER_BYTES:]
        self._port.write(body + FramerRTU.compute_CRC(body).to_bytes(2, "big"))
