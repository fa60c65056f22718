"""Modbus devices of the virtual bench and their TCP server: measuring amplifier, brake supply, remote I/O.

pymodbus does the framing, the PDUs and the connections. Requests are answered where they arrive instead of through its
data store: the values are those of the plant at the moment of the request, and at 1000 requests per second the store's
task per request costs more than everything else. All of pymodbus that the virtual bench uses is named in this file.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from pymodbus import ExceptionResponse
from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusIOException
from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    ReadInputRegistersRequest,
    ReadInputRegistersResponse,
    WriteMultipleRegistersRequest,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterRequest,
    WriteSingleRegisterResponse,
)
from pymodbus.server import ModbusTcpServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice

from drivers.profile import ModbusProfile, WriteField
from virtual_bench.bench_time import BenchTime
from virtual_bench.config import ModbusPort
from virtual_bench.faults.modbus_faults import ModbusFaults
from virtual_bench.wires.hang_up import hang_up

WORDS: dict[str, int] = {"u16": 1, "i16": 1, "u32": 2, "i32": 2}
RANGES: dict[str, tuple[int, int]] = {
    "u16": (0, 0xFFFF),
    "i16": (-0x8000, 0x7FFF),
    "u32": (0, 0xFFFFFFFF),
    "i32": (-0x80000000, 0x7FFFFFFF),
}


class Device:
    """One device: its registers, what it reads from the plant and what a write does."""

    def __init__(
        self,
        port: ModbusPort,
        read: Callable[[], Mapping[str, float]],
        write: Callable[[dict[str, float]], None] | None = None,
    ) -> None:
        self.registers = port.registers
        block = port.registers.write
        self._fields = block.fields if block else ()
        self._write_address = block.address if block else 0
        self.unit_id = port.unit_id
        self._read = read
        self._write = write
        self._holding = [0] * sum(WORDS[row.type] for row in self._fields)

    def answer(self, request: ModbusPDU) -> ModbusPDU:
        """Return the response, or an exception response: unknown unit 11, function 1, address 2, value 3."""
        code = request.function_code
        if request.dev_id != self.unit_id:
            return ExceptionResponse(code, ExcCodes.GATEWAY_NO_RESPONSE)
        match request:
            case ReadInputRegistersRequest() if self.registers.read.table == "input":
                return self._answer_read(request, ReadInputRegistersResponse)
            case ReadHoldingRegistersRequest():
                return self._answer_holding(request)
            case WriteMultipleRegistersRequest() if self._write is not None:
                refused = self._take(request.address, request.registers)
                return refused or WriteMultipleRegistersResponse(address=request.address, count=len(request.registers))
            case WriteSingleRegisterRequest() if self._write is not None:
                refused = self._take(request.address, request.registers)
                return refused or WriteSingleRegisterResponse(address=request.address, registers=request.registers)
        return ExceptionResponse(code, ExcCodes.ILLEGAL_FUNCTION)

    def _answer_read(
        self,
        request: ModbusPDU,
        response: type[ReadInputRegistersResponse | ReadHoldingRegistersResponse],
    ) -> ModbusPDU:
        first = request.address - self.registers.read.address
        if first < 0 or request.count < 1 or first + request.count > self.registers.read.count:
            return ExceptionResponse(request.function_code, ExcCodes.ILLEGAL_ADDRESS)
        words = encode(self.registers, {**self._read(), "identity": self.registers.identity.value})
        return response(registers=words[first : first + request.count])

    def _answer_holding(self, request: ModbusPDU) -> ModbusPDU:
        if self.registers.read.table == "holding" and self.registers.write is None:
            return self._answer_read(request, ReadHoldingRegistersResponse)
        first = request.address - self._write_address
        if first < 0 or request.count < 1 or first + request.count > len(self._holding):
            return ExceptionResponse(request.function_code, ExcCodes.ILLEGAL_ADDRESS)
        return ReadHoldingRegistersResponse(registers=self._holding[first : first + request.count])

    def _take(self, address: int, words: Sequence[int]) -> ExceptionResponse | None:
        """Store written registers and let them act; returns the refusal, if any."""
        first = address - self._write_address
        if first < 0 or first + len(words) > len(self._holding):
            return ExceptionResponse(WriteMultipleRegistersRequest.function_code, ExcCodes.ILLEGAL_ADDRESS)
        self._holding[first : first + len(words)] = words
        if self._write is not None:
            self._write(decode(self._fields, self._holding))
        return None


class ModbusServer:
    """One device on its own port; `faults` has those of the device `name`.

    While a scan leads, requests wait for `answer_waiting`, and `arrived` is told of each.
    """

    def __init__(self, name: str, device: Device, time: BenchTime, faults: ModbusFaults) -> None:
        self.name = name
        self.device = device
        self.faults = faults
        self.requests = 0
        """Whole requests that have come."""
        self.bytes_sent = 0
        self.arrived: Callable[[], None] = _nothing
        self._time = time
        self._waiting: list[Callable[[], None]] = []
        self.connections: set[Connection] = set()
        self._server: _Server | None = None

    async def start(self, host: str, port: int) -> int:
        """Listen and return the port; port 0 takes a free one. Raises `OSError` when it cannot be had."""
        self._server = _Server(self, host, port)
        try:
            await self._server.serve_forever(background=True)
        except RuntimeError as error:
            raise OSError(f"{self.device.registers.profile.name}: port {port} on {host} is not available") from error
        transport: Any = self._server.transport
        return int(transport.sockets[0].getsockname()[1])

    def answer(
        self, request: ModbusPDU, asked: bytes, build: Callable[[ModbusPDU], bytes], send: Callable[[bytes], None]
    ) -> None:
        """Answer a request as the device's faults say: at once, late, wrongly, or not at all.

        `asked` is its frame as on TCP; `build` makes such a frame of the response, and `send` gets what goes out.
        """
        self.requests += 1
        if self._time.led:
            self._waiting.append(partial(self._answer, request, asked, build, send))
            self.arrived()
        else:
            self._answer(request, asked, build, send)

    def answer_waiting(self) -> None:
        """Answer what has come while a scan led, in the order in which it came."""
        waiting, self._waiting = self._waiting, []
        for answer in waiting:
            answer()

    @property
    def reachable(self) -> bool:
        """Whether requests can come: somebody is connected, or the device is on a serial line."""
        return self._server is None or bool(self.connections)

    def _answer(
        self, request: ModbusPDU, asked: bytes, build: Callable[[ModbusPDU], bytes], send: Callable[[bytes], None]
    ) -> None:
        faults = self.faults
        if faults.is_cut(self.name):
            return
        pieces = faults.in_place(self.name, asked)
        if pieces is None:
            self._time.advance()
            response = self.device.answer(request)
            response.dev_id, response.transaction_id = request.dev_id, request.transaction_id
            pieces = faults.answer(self.name, asked, build(response))
        for piece in pieces:
            if piece.delay_s:
                self._time.after(piece.delay_s, partial(self._send, send, piece.data))
            else:
                self._send(send, piece.data)

    def _send(self, send: Callable[[bytes], None], data: bytes) -> None:
        self.bytes_sent += len(data)
        send(data)

    def cut(self) -> None:
        """Drop all connections."""
        for connection in list(self.connections):
            connection.drop()

    async def stop(self) -> None:
        """Close the port and all connections."""
        self.cut()
        if self._server is not None:
            await self._server.shutdown()  # type: ignore[no-untyped-call]


def _nothing() -> None:
    """Tell nobody."""


class _Server(ModbusTcpServer):
    """pymodbus' TCP server with our connections instead of its own."""

    def __init__(self, owner: ModbusServer, host: str, port: int) -> None:
        # The store is never asked; the server insists on one.
        store = SimDevice(owner.device.unit_id, SimData(0, values=0, datatype=DataType.REGISTERS))
        super().__init__(store, address=(host, port))
        self._owner = owner

    def callback_new_connection(self) -> Connection:
        """Return the protocol of a new connection."""
        return Connection(self, self._owner)


class Connection(ServerRequestHandler):
    """One client; answers at once, and all requests of a packet instead of only the first."""

    def __init__(self, server: _Server, owner: ModbusServer) -> None:
        super().__init__(server, None, None, None)  # type: ignore[no-untyped-call]
        self._owner = owner

    def callback_connected(self) -> None:
        """Take the connection, or drop it while the line is cut."""
        super().callback_connected()
        self._owner.connections.add(self)
        if self._owner.faults.is_cut(self._owner.name):
            self.drop()

    def callback_disconnected(self, exc: Exception | None) -> None:
        """Forget the connection."""
        super().callback_disconnected(exc)
        self._owner.connections.discard(self)

    def callback_data(self, data: bytes, addr: tuple[Any, ...] | None = None) -> int:
        """Answer every complete request in `data` and return how much of it was used."""
        owner = self._owner
        if owner.faults.is_cut(owner.name):
            self.drop()
            return len(data)
        used = 0
        while used < len(data):
            try:
                length, request = self.framer.handleFrame(data[used:], 0, 0)
            except ModbusIOException as error:
                response: ModbusPDU = ExceptionResponse(error.fcode or 0, ExcCodes.ILLEGAL_FUNCTION)
                response.dev_id, response.transaction_id = error.dev_id, error.transaction_id
                self.pdu_send(response, addr=addr)
                return len(data)
            if not length:
                break
            used += length
            if request is not None:
                owner.answer(request, data[used - length : used], self.framer.buildFrame, self._send)
        return used

    def _send(self, data: bytes) -> None:
        if isinstance(self.transport, asyncio.Transport) and not self.transport.is_closing():
            self.transport.write(data)

    def drop(self) -> None:
        """End the connection at once."""
        if isinstance(self.transport, asyncio.Transport):
            hang_up(self.transport)


def encode(registers: ModbusProfile, values: Mapping[str, float]) -> list[int]:
    """Return the words of the read block; numbers beyond their type stop at its end, as a device's do."""
    block = bytearray(2 * registers.read.count)
    for row in registers.read.fields:
        value = values[row.name]
        if row.bit is not None:
            word = struct.unpack_from(">H", block, 2 * row.offset)[0] | (int(value) & 1) << row.bit
            struct.pack_into(">H", block, 2 * row.offset, word)
            continue
        low, high = RANGES[row.type]
        # not a number becomes the lowest count, as measuring amplifiers show it
        count = low if value != value else min(max(round(value / (row.scale or 1.0)), low), high)  # noqa: PLR0124
        block[2 * row.offset : 2 * (row.offset + WORDS[row.type])] = (count & 0xFFFFFFFF).to_bytes(4, "big")[
            -2 * WORDS[row.type] :
        ]
    return list(struct.unpack(f">{registers.read.count}H", block))


def decode(rows: tuple[WriteField, ...], words: list[int]) -> dict[str, float]:
    """Return the values in a block of written words."""
    values = {}
    for row in rows:
        raw = b"".join(word.to_bytes(2, "big") for word in words[row.offset : row.offset + WORDS[row.type]])
        count = int.from_bytes(raw, "big", signed=row.type.startswith("i"))
        values[row.name] = count * (row.scale or 1.0)
    return values
