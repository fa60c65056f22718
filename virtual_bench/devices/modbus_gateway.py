"""The gateway's Modbus side: a port on loopback for each device of the bench, with wire faults on what passes.

A request goes on to the device unless a fault answers in its place; what the device answers passes the faults too.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from definitions.profiles.modbus import ModbusProfile
from virtual_bench.faults.modbus_faults import ModbusFaults, Piece

HOST = "127.0.0.1"
LENGTH_AT, UNIT_AT = 4, 6


@dataclass(frozen=True)
class ModbusTarget:
    """A Modbus TCP device of the bench."""

    host: str
    port: int
    unit_id: int
    registers: ModbusProfile


class ModbusGateway:
    """One device's port for the controller; every connection has its own to the device."""

    def __init__(self, name: str, target: ModbusTarget, faults: ModbusFaults) -> None:
        self._name, self._target, self._faults = name, target, faults
        self._server: asyncio.Server | None = None
        self._writers: set[asyncio.StreamWriter] = set()

    async def start(self) -> int:
        """Listen and return the port."""
        self._server = await asyncio.start_server(self._serve, HOST, 0)
        return int(self._server.sockets[0].getsockname()[1])

    def cut(self) -> None:
        """Drop all connections."""
        for writer in list(self._writers):
            writer.transport.abort()

    async def stop(self) -> None:
        """Close the port and all connections."""
        if self._server is not None:
            self._server.close()
        self.cut()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._faults.is_cut(self._name):
            writer.transport.abort()
            return
        try:
            device_reader, device_writer = await asyncio.open_connection(self._target.host, self._target.port)
        except OSError:
            writer.transport.abort()
            return
        ends = {writer, device_writer}
        self._writers |= ends
        asked: dict[bytes, bytes] = {}
        try:
            await asyncio.gather(
                self._pass_requests(reader, writer, device_writer, asked),
                self._pass_answers(device_reader, writer, asked),
            )
        except (asyncio.IncompleteReadError, OSError):
            pass  # one side has closed: so do we, on both
        finally:
            self._writers -= ends
            for end in ends:
                end.transport.abort()

    async def _pass_requests(
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        device: asyncio.StreamWriter,
        asked: dict[bytes, bytes],
    ) -> None:
        while True:
            request = await _frame(reader)
            pieces = self._faults.in_place(self._name, request)
            if pieces is None:
                asked[request[:2]] = request
                device.write(request)
            else:
                _send(writer, pieces)

    async def _pass_answers(
        self, device: asyncio.StreamReader, writer: asyncio.StreamWriter, asked: dict[bytes, bytes]
    ) -> None:
        while True:
            response = await _frame(device)
            request = asked.pop(response[:2], None)
            _send(
                writer,
                [Piece(0.0, response)] if request is None else self._faults.answer(self._name, request, response),
            )


async def _frame(reader: asyncio.StreamReader) -> bytes:
    """Read one Modbus TCP frame."""
    head = await reader.readexactly(UNIT_AT)
    return head + await reader.readexactly(int.from_bytes(head[LENGTH_AT:UNIT_AT], "big"))


def _send(writer: asyncio.StreamWriter, pieces: list[Piece]) -> None:
    for piece in pieces:
        if piece.delay_s:
            asyncio.get_running_loop().call_later(piece.delay_s, _write, writer, piece.data)
        else:
            _write(writer, piece.data)


def _write(writer: asyncio.StreamWriter, data: bytes) -> None:
    if not writer.transport.is_closing():
        writer.write(data)
