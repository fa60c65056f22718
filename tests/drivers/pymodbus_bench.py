"""The three Modbus devices of the virtual bench by pymodbus' own servers, in a thread of the test process."""

from __future__ import annotations

import asyncio
import threading

from drivers_support import modbus_profile, raw_profile
from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from definitions.image import REMOTE_IO_FIELDS

AMPLIFIER, BRAKE, REMOTE_IO = 1, 2, 3
WRITE_REGISTERS = 16


REMOTE_IO_READ = modbus_profile(raw_profile("virtual-remote-io")).read
REMOTE_IO_SHOWS = {
    field.name: round(25.3 - 7.3 * place, 1) if field.unit == "°C" else int(field.name != "enabling_device")
    for place, field in enumerate(REMOTE_IO_FIELDS)
}
"""What contacts and sensors at the remote I/O show: a temperature of its own for each sensor, some below zero."""

(LIFE_COUNTER,) = (field for field in REMOTE_IO_READ.fields if field.name == "life_counter")


def _contacts_and_sensors() -> list[int]:
    """Return the registers of the remote I/O, where its profile has them."""
    registers = [0x4C49, *[0] * (REMOTE_IO_READ.count - 1)]
    for field in REMOTE_IO_READ.fields:
        value = REMOTE_IO_SHOWS.get(field.name, 0)
        if field.bit is not None:
            registers[field.offset] |= int(value) << field.bit
        elif field.type == "i16":
            registers[field.offset] = round(value / field.scale) & 0xFFFF
    return registers


def _device(unit_id: int, inputs: list[int], holdings: list[int], action: object) -> SimDevice:
    nothing = [SimData(0, values=[False], datatype=DataType.BITS)]
    blocks = (
        nothing,
        nothing,
        [SimData(0, values=holdings, datatype=DataType.REGISTERS)],
        [SimData(0, values=inputs, datatype=DataType.REGISTERS)],
    )
    return SimDevice(unit_id, simdata=blocks, action=action)  # type: ignore[arg-type]


class PymodbusBench:
    """Server on a free TCP port, or on a serial port: the amplifier counts its samples, the brake does as told."""

    def __init__(self, serial_port: str = "") -> None:
        self._serial_port = serial_port
        self.orders = [0, 0]
        self.writes = 0
        self.sample_counter = 0
        self.counting = True
        self.alive = True
        self.exception: ExcCodes | None = None
        self.torque_out_counts = 1_234_567
        self.port = 0
        self._loop = asyncio.new_event_loop()
        self._up = threading.Event()
        self._server: ModbusTcpServer | ModbusSerialServer | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._up.wait(5)

    async def _amplify(
        self, _function: int, _start: int, _address: int, _count: int, now: list[int], _new: object
    ) -> object:
        self.sample_counter += self.counting
        torque = self.torque_out_counts.to_bytes(4, "big", signed=True)
        now[2:4] = self.sample_counter >> 16, self.sample_counter & 0xFFFF
        now[8:10] = int.from_bytes(torque[:2], "big"), int.from_bytes(torque[2:], "big")
        return self.exception

    async def _brake(
        self, function: int, _start: int, _address: int, _count: int, now: list[int], new: object
    ) -> object:
        if function == WRITE_REGISTERS:
            self.orders = list(new)  # type: ignore[call-overload]
            self.writes += 1
        else:
            now[1:3] = self.orders
            now[3] += self.alive
        return self.exception

    async def _contacts(
        self, _function: int, _start: int, _address: int, _count: int, now: list[int], _new: object
    ) -> object:
        now[LIFE_COUNTER.offset] += self.alive
        return self.exception

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._serve())

    async def _serve(self) -> None:
        devices = [
            _device(AMPLIFIER, [0x4C41, *[0] * 13], [0], self._amplify),
            _device(BRAKE, [0x4C42, 0, 0, 0], [0, 0], self._brake),
            _device(REMOTE_IO, _contacts_and_sensors(), [0], self._contacts),
        ]
        if self._serial_port:
            self._server = ModbusSerialServer(devices, port=self._serial_port, baudrate=115200)
            await self._server.listen()
        else:
            self._server = ModbusTcpServer(devices, address=("127.0.0.1", 0))
            await self._server.listen()
            self.port = self._server.transport.sockets[0].getsockname()[1]  # type: ignore[union-attr]
        self._up.set()
        await self._server.serving

    def close(self) -> None:
        if self._server is not None and self._thread.is_alive():
            asyncio.run_coroutine_threadsafe(self._server.shutdown(), self._loop).result(5)
            self._thread.join(5)
        self._loop.close()
