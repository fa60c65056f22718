"""Each function code that a profile can ask for: the request, and the reply of a device that shares no code with it."""

from __future__ import annotations

from typing import Any

import pytest
from drivers_support import modbus_config, modbus_profile, raw_profile
from pymodbus.framer import FramerSocket
from pymodbus.pdu import DecodePDU

from definitions.profiles.modbus import COIL_TABLES
from drivers.config import ModbusConfig
from drivers.modbus.device import ModbusDevice
from drivers.modbus.frames import Outcome, reply_to
from drivers.modbus.line import ModbusLine
from drivers.wire_image import WireImage
from virtual_bench.config import ModbusPort
from virtual_bench.devices.modbus_servers import Device

READS = {"coil": 1, "discrete": 2, "holding": 3, "input": 4}
WRITES = {("coil", True): 5, ("holding", True): 6, ("coil", False): 15, ("holding", False): 16}


def profile(read_table: str, write_table: str, *, single: bool) -> Any:
    is_bit = write_table == "coil"
    name = "brake_on" if is_bit else "brake_current_a"
    read = {"name": name, "offset": 9, "type": "bit" if read_table in COIL_TABLES else "u16"}
    written: dict[str, Any] = {"name": name, "offset": 0, "type": "bit" if is_bit else "u16"}
    return modbus_profile(
        {
            "profile": {"name": "brake", "kind": "modbus"},
            "read": {"table": read_table, "address": 8, "count": 12, "fields": [read]},
            "write": {"table": write_table, "address": 40, "single": single, "fields": [written]},
        }
    )  # fmt: skip


class Pair:
    """A device of the driver and one of the virtual bench, and pymodbus' framer between them instead of a wire."""

    def __init__(self, registers: Any) -> None:
        self.written: list[dict[str, float]] = []
        config: ModbusConfig = modbus_config("virtual-brake", 7, profile=registers)
        self.device = ModbusDevice(config, ModbusLine(config, 5, 15), 1, 100)
        self.other = Device(ModbusPort(registers, 7), self.shown, self.written.append)
        self.framer = FramerSocket(DecodePDU(is_server=True))

    def shown(self) -> dict[str, float]:
        last = self.written[-1] if self.written else {}
        return {"brake_on": 0, "brake_current_a": 0} | last

    def asks(self, request: Any) -> int:
        """Let the other device answer a request; return its function code."""
        used, pdu = self.framer.handleFrame(request.frame, 0, 0)
        assert (used, pdu.dev_id) == (len(request.frame), 7)
        response = self.other.answer(pdu)
        response.dev_id = 7
        reply = reply_to(request, self.framer.buildFrame(response)[6:])
        assert reply.outcome is Outcome.DATA
        self.device._pending_is_write = request is self.device._write_request
        self.device._take(request, reply.data, 1)
        return int(pdu.function_code)


ALIKE = [
    (read, write, single)
    for read in READS
    for write, single in WRITES
    if (read in COIL_TABLES) == (write in COIL_TABLES)
]
"""A bit is read back as a bit, and a number as a number."""


@pytest.mark.parametrize(("read_table", "write_table", "single"), ALIKE)
def test_every_function_code_writes_and_reads_back(read_table: str, write_table: str, *, single: bool) -> None:
    pair = Pair(profile(read_table, write_table, single=single))
    name = "brake_on" if write_table == "coil" else "brake_current_a"
    for wanted in (1, 0, 1) if name == "brake_on" else (1, 0, 65535):
        pair.device.order({"brake_on": wanted, "brake_current_a": wanted})
        assert pair.asks(pair.device._write_request) == WRITES[write_table, single]
        assert pair.written[-1] == {name: wanted}
        assert pair.asks(pair.device._read_request) == READS[read_table]
        assert pair.device.values[pair.device.place(name)] == wanted


def test_a_brake_that_measures_no_current_shows_the_ordered_one_while_it_is_on() -> None:
    pair = Pair(modbus_profile(raw_profile("coil-brake")))
    io = Pair(modbus_profile(raw_profile("virtual-remote-io"))).device
    image = WireImage(io, pair.device, io, fixed_current_a=9.0)

    def shown() -> tuple[int, float]:
        pair.asks(pair.device._read_request)
        image._take_lock(pair.device.values)
        return image._image.brake_on, image._image.brake_current_a

    assert shown() == (0, 0.0)
    pair.written.append({"brake_on": 1})
    assert shown() == (1, 9.0), "found on, and never ordered a current: what its supply gives"
    pair.device.order({"brake_on": 1, "brake_current_a": 6.0})
    assert shown() == (1, 6.0)
    pair.written.append({"brake_on": 0})
    assert shown() == (0, 0.0), "ordered on, and it says that it is off"
