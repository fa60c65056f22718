"""Modbus devices of the virtual bench and their TCP server: measuring amplifier, brake supply, remote I/O.

pymodbus does the framing and the PDUs. Requests are answered where they arrive instead of by its server with its data
store: the values are those of the plant at the moment of the request, at 1000 requests per second the store's task per
request costs more than everything else, and the server brings an HTTP server with it.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import cast

from pymodbus import ExceptionResponse
from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusIOException
from pymodbus.framer import FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.bit_message import (
    ReadCoilsResponse,
    ReadDiscreteInputsResponse,
    WriteMultipleCoilsRequest,
    WriteMultipleCoilsResponse,
    WriteSingleCoilRequest,
    WriteSingleCoilResponse,
)
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersResponse,
    ReadInputRegistersResponse,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterRequest,
    WriteSingleRegisterResponse,
)

from definitions.profiles.modbus import COIL_TABLES, ModbusProfile, ReadBlock
from virtual_bench.bench_time import BenchTime
from virtual_bench.config import ModbusPort
from virtual_bench.faults.modbus_faults import ModbusFaults
from virtual_bench.wires.hang_up import hang_up

WORDS: dict[str, int] = {"u16": 1, "i16": 1, "u32": 2, "i32": 2, "f32": 2, "bit": 1}
READS: dict[int, tuple[str, type[ModbusPDU]]] = {
    1: ("coil", ReadCoilsResponse),
    2: ("discrete", ReadDiscreteInputsResponse),
    3: ("holding", ReadHoldingRegistersResponse),
    4: ("input", ReadInputRegistersResponse),
}
"""Table and response of each function code that reads."""
WRITES: dict[int, str] = {5: "coil", 6: "holding", 15: "coil", 16: "holding"}
"""Table of each function code that writes."""
RANGES: dict[str, tuple[int, int]] = {
    "u16": (0, 0xFFFF),
    "i16": (-0x8000, 0x7FFF),
    "u32": (0, 0xFFFFFFFF),
    "i32": (-0x80000000, 0x7FFFFFFF),
}
FLOAT, FLOAT_BITS = struct.Struct(">f"), struct.Struct(">I")


class Device:
    """One device: its registers and coils, what it reads from the plant and what a write does."""

    def __init__(
        self,
        port: ModbusPort,
        read: Callable[[], Mapping[str, float]],
        write: Callable[[dict[str, float]], None] | None = None,
    ) -> None:
        self.registers = port.registers
        block = port.registers.write
        fields = block.fields if block else ()
        self._write_table, self._write_address = (block.table, block.address) if block else ("", 0)
        self._blocks = (port.registers.read, *port.registers.read_also)
        self.unit_id = port.unit_id
        self.beside: list[Device] = []
        """Other parts of the same device: they have its connection and its unit id."""
        self._read = read
        self._write = write
        self._written = [0] * sum(WORDS[row.type] for row in fields)

    def has(self, request: ModbusPDU) -> bool:
        """Say whether what is asked for is a part of this device, where several have one unit id."""
        if request.dev_id != self.unit_id:
            return False
        code = request.function_code
        table = READS[code][0] if code in READS else WRITES.get(code, "")
        parts = [(self._write_table, self._write_address, len(self._written))]
        parts += [(block.table, block.address, block.count) for block in self._blocks if code in READS]
        asked = max(request.count, 1)
        return any(name == table and 0 <= request.address - first <= count - asked for name, first, count in parts)

    def shown(self, table: str, address: int, count: int) -> list[int]:
        """Return what this part of a device shows in so many words or bits; 0 in those that are not its own."""
        found = [0] * count
        for block in self._blocks:
            if block.table == table:
                for place, word in enumerate(
                    encode(self.registers, self._read(), block), start=block.address - address
                ):
                    if 0 <= place < count:
                        found[place] |= word
        return found

    def answer(self, request: ModbusPDU) -> ModbusPDU:
        """Return the response, or an exception response: unknown unit 11, function 1, address 2, value 3."""
        code = request.function_code
        if request.dev_id != self.unit_id:
            return ExceptionResponse(code, ExcCodes.GATEWAY_NO_RESPONSE)
        if code in READS:
            table, response = READS[code]
            return self._answer_read(request, table, response)
        if self._write is None or WRITES.get(code) != self._write_table:
            return ExceptionResponse(code, ExcCodes.ILLEGAL_FUNCTION)
        if isinstance(request, WriteSingleCoilRequest | WriteMultipleCoilsRequest):
            words = [int(bit) for bit in request.bits[: request.count or 1]]
        else:
            words = list(request.registers)
        return self._take(request, words) or _echo(request, words)

    def _answer_read(self, request: ModbusPDU, table: str, response: type[ModbusPDU]) -> ModbusPDU:
        for block in self._blocks:
            first = request.address - block.address
            if block.table == table and first >= 0 and 0 < request.count <= block.count - first:
                words = encode(self.registers, self._read(), block)[first : first + request.count]
                for part in self.beside:
                    others = part.shown(table, request.address, request.count)
                    words = [word | other for word, other in zip(words, others, strict=True)]
                return _response(response, words)
        first = request.address - self._write_address
        if table == self._write_table and first >= 0 and 0 < request.count <= len(self._written) - first:
            return _response(response, self._written[first : first + request.count])
        known = table == self._write_table or any(block.table == table for block in self._blocks)
        code = ExcCodes.ILLEGAL_ADDRESS if known else ExcCodes.ILLEGAL_FUNCTION
        return ExceptionResponse(request.function_code, code)

    def _take(self, request: ModbusPDU, words: Sequence[int]) -> ExceptionResponse | None:
        """Store what was written and let it act; returns the refusal, if any."""
        first = request.address - self._write_address
        if first < 0 or first + len(words) > len(self._written):
            return ExceptionResponse(request.function_code, ExcCodes.ILLEGAL_ADDRESS)
        self._written[first : first + len(words)] = words
        if self._write is not None:
            self._write(decode(self.registers, self._written))
        return None


def _echo(request: ModbusPDU, words: Sequence[int]) -> ModbusPDU:
    """Return what confirms a write: address and number of what was written, or for a single one its value."""
    match request:
        case WriteSingleRegisterRequest():
            return WriteSingleRegisterResponse(address=request.address, registers=list(words))
        case WriteSingleCoilRequest():
            return WriteSingleCoilResponse(address=request.address, bits=[bool(words[0])])
        case WriteMultipleCoilsRequest():
            return WriteMultipleCoilsResponse(address=request.address, count=len(words))
    return WriteMultipleRegistersResponse(address=request.address, count=len(words))


def _response(kind: type[ModbusPDU], words: Sequence[int]) -> ModbusPDU:
    if kind in (ReadCoilsResponse, ReadDiscreteInputsResponse):
        return kind(bits=[bool(word) for word in words])
    return kind(registers=list(words))


class ModbusServer:
    """One device on its own port, or on one with others; `faults` has those of the device `name`.

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
        self._server: asyncio.Server | None = None

    async def start(self, host: str, port: int, partners: Sequence[ModbusServer] = ()) -> int:
        """Listen and return the port; port 0 takes a free one. Raises `OSError` when it cannot be had.

        partners: devices behind the same connection, as behind a gateway; or parts of the same device, by its unit id.
        """
        together = (self, *partners)
        try:
            server = await asyncio.get_running_loop().create_server(partial(Connection, together), host, port)
        except OSError as error:
            raise OSError(
                f"{self.device.registers.profile.name}: port {port} on {host} is not available. Choose another port"
            ) from error
        for one in together:
            one._server = server  # noqa: SLF001 - of its own class
            unit = one.device.unit_id
            one.device.beside = [
                other.device for other in together if other is not one and other.device.unit_id == unit
            ]
        return int(server.sockets[0].getsockname()[1])

    def answer(
        self, request: ModbusPDU, asked: bytes, build: Callable[[ModbusPDU], bytes], send: Callable[[bytes], int]
    ) -> None:
        """Answer a request as the device's faults say: at once, late, wrongly, or not at all.

        `asked` is its frame as on TCP; `build` makes such a frame of the response. `send` gets what goes out, and
        returns how many bytes of its own line that is.
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
        self, request: ModbusPDU, asked: bytes, build: Callable[[ModbusPDU], bytes], send: Callable[[bytes], int]
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

    def _send(self, send: Callable[[bytes], int], data: bytes) -> None:
        self.bytes_sent += send(data)

    def cut(self) -> None:
        """Drop all connections."""
        for connection in list(self.connections):
            connection.drop()

    async def stop(self) -> None:
        """Close the port and all connections."""
        self.cut()
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()


def _nothing() -> None:
    """Tell nobody."""


class Connection(asyncio.Protocol):
    """One client; answers at once, and all requests of a packet. A fault that cuts one of the devices cuts all."""

    def __init__(self, owners: Sequence[ModbusServer]) -> None:
        self._owners = owners
        self._framer = FramerSocket(DecodePDU(is_server=True))
        self._buffer = b""
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the connection, or drop it while the line is cut."""
        self._transport = cast("asyncio.Transport", transport)  # a TCP server makes no other
        for owner in self._owners:
            owner.connections.add(self)
        if self._cut:
            self.drop()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - as asyncio calls it
        """Forget the connection."""
        for owner in self._owners:
            owner.connections.discard(self)

    def data_received(self, data: bytes) -> None:
        """Answer every complete request, and keep the beginning of the next one."""
        if self._cut:
            self.drop()
            return
        self._buffer += data
        while self._buffer:
            try:
                length, request = self._framer.handleFrame(self._buffer, 0, 0)
            except ModbusIOException as error:
                response: ModbusPDU = ExceptionResponse(error.fcode or 0, ExcCodes.ILLEGAL_FUNCTION)
                response.dev_id, response.transaction_id = error.dev_id, error.transaction_id
                self._buffer = b""
                self._send(self._framer.buildFrame(response))
                return
            if not length:
                return
            asked, self._buffer = self._buffer[:length], self._buffer[length:]
            if request is not None:
                self._owner(request).answer(request, asked, self._framer.buildFrame, self._send)

    @property
    def _cut(self) -> bool:
        return any(owner.faults.is_cut(owner.name) for owner in self._owners)

    def _owner(self, request: ModbusPDU) -> ModbusServer:
        """Return the device that a request is for; that refuses it where none has what is asked for."""
        if len(self._owners) == 1:
            return self._owners[0]
        asked = [owner for owner in self._owners if owner.device.has(request)]
        asked += [owner for owner in self._owners if owner.device.unit_id == request.dev_id]
        return (asked or self._owners)[0]

    def _send(self, data: bytes) -> int:
        if self._transport is None or self._transport.is_closing():
            return 0
        self._transport.write(data)
        return len(data)

    def drop(self) -> None:
        """End the connection at once."""
        if self._transport is not None:
            hang_up(self._transport)


def encode(registers: ModbusProfile, values: Mapping[str, float], read: ReadBlock | None = None) -> list[int]:
    """Return the words of a read block, or its bits; numbers beyond their type stop at its end, as a device's do.

    The identity stands where the profile says, whether a field shows it or not.
    """
    read = read or registers.read
    if read.table in COIL_TABLES:
        bits = [0] * read.count
        for row in read.fields:
            bits[row.offset] = 1 if values[row.name] else 0
        return bits
    words = [0] * read.count
    for row in read.fields:
        if row.name == "identity":
            continue
        value, offset = values[row.name], row.offset
        if row.bit is not None:
            words[offset] |= (int(value) & 1) << row.bit
            continue
        value = (value - (row.zero or 0.0)) / (row.scale or 1.0)
        if row.type == "f32":
            (number,) = FLOAT_BITS.unpack(FLOAT.pack(value))
        else:
            low, high = RANGES[row.type]
            # not a number becomes the lowest count, as measuring amplifiers show it
            number = low if value != value else min(max(round(value), low), high)  # noqa: PLR0124
        if WORDS[row.type] == 1:
            words[offset] = number & 0xFFFF
        else:
            words[offset : offset + 2] = _two_words(number, registers.word_order)
    _put_identity(words, registers, read)
    return [word >> 8 | word << 8 & 0xFF00 for word in words] if registers.byte_order == "little" else words


def _two_words(number: int, word_order: str) -> tuple[int, int]:
    """Return the registers that hold a number of 32 bits, in the device's order of words."""
    high, low = number >> 16 & 0xFFFF, number & 0xFFFF
    return (low, high) if word_order == "little" else (high, low)


def _put_identity(words: list[int], registers: ModbusProfile, read: ReadBlock) -> None:
    identity = registers.identity
    if identity is None or identity.table != read.table:
        return
    first, count = identity.address - read.address, identity.count
    if not 0 <= first <= read.count - count:
        return
    if identity.text is not None:
        text = identity.text.encode("ascii").ljust(2 * count, b"\0")
        words[first : first + count] = struct.unpack(f">{count}H", text)
    elif identity.value is not None:
        one = count == 1
        words[first : first + count] = [identity.value] if one else _two_words(identity.value, registers.word_order)


def decode(registers: ModbusProfile, words: Sequence[int]) -> dict[str, float]:
    """Return the values in a block of written words."""
    rows = registers.write.fields if registers.write else ()
    if registers.byte_order == "little":
        words = [word >> 8 | word << 8 & 0xFF00 for word in words]
    values = {}
    for row in rows:
        taken = words[row.offset : row.offset + WORDS[row.type]]
        raw = b"".join(word.to_bytes(2, "big") for word in (taken[::-1] if registers.word_order == "little" else taken))
        count = int.from_bytes(raw, "big", signed=row.type.startswith("i"))
        values[row.name] = count * (row.scale or 1.0)
    return values
