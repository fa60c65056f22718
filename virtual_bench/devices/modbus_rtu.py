"""Modbus RTU lines of the virtual bench: devices with their own unit ids on one serial port, as on an RS-485 pair.

Requests are framed by pymodbus and answered by the same devices as on TCP. A device answers its own unit id only;
nobody answers another, nor a frame whose check sum is wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU

from virtual_bench.bench_time import BenchTime
from virtual_bench.devices.modbus_servers import ModbusServer
from virtual_bench.wires.pty_port import PtyPort

LONGEST_FRAME = 256
"""Bytes of the longest frame that the protocol allows."""

TCP_HEADER_BYTES = 6
"""Transaction, protocol and length, which RTU has not."""

GAP_S = 0.02
"""A piece of a frame that is not continued within this time is given up, as after a silence on a real line."""


class RtuLine:
    """One serial port with its devices."""

    def __init__(
        self, servers: list[ModbusServer], link: str, log: Callable[[str, str], None], time: BenchTime
    ) -> None:
        self._servers = {server.device.unit_id: server for server in servers}
        self._port = PtyPort(self._take, link)
        self._log = log
        self._framer = FramerRTU(DecodePDU(is_server=True))
        self._tcp = FramerSocket(DecodePDU(is_server=True))  # faults change frames of TCP
        self._buffer = b""
        self._time = time
        self._pieces = 0

    async def start(self) -> str:
        """Make the serial port and return its path; raises `OSError` when it cannot be had."""
        return self._port.open()

    async def stop(self) -> None:
        """Pull the cable."""
        self._port.close()

    def _take(self, data: bytes) -> None:
        self._pieces += 1
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
            self._time.after(GAP_S, partial(self._give_up, self._pieces))
        if request is not None and request.dev_id in self._servers:
            asked = self._tcp.buildFrame(request)
            self._servers[request.dev_id].answer(request, asked, self._tcp.buildFrame, self._reply)

    def _give_up(self, pieces: int) -> None:
        if pieces == self._pieces:  # otherwise it was continued
            self._buffer = b""

    def _reply(self, response: bytes) -> int:
        """Send a response that faults have left as a frame of TCP; on this line it has a check sum and no header."""
        body = response[TCP_HEADER_BYTES:]
        frame = body + FramerRTU.compute_CRC(body).to_bytes(2, "big")
        return len(frame) if self._port.write(frame) else 0
