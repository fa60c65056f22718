"""Serial ports of the virtual bench: RTU lines asked by pymodbus' own client, names of ports, a bus after its end."""

from __future__ import annotations

import asyncio
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import can
import pytest
from pymodbus.client import AsyncModbusSerialClient
from pymodbus.exceptions import ModbusIOException

from definitions.profiles.modbus import IdentityRegister, ModbusProfile, ModbusProfileHeader, ReadBlock, ReadField
from virtual_bench.bench_time import BenchTime
from virtual_bench.config import CanBus, ModbusPort
from virtual_bench.devices.modbus_rtu import RtuLine
from virtual_bench.devices.modbus_servers import Device, ModbusServer
from virtual_bench.faults.modbus_faults import ModbusFaults
from virtual_bench.faults.scenario import Fault, Header, Scenario, When
from virtual_bench.faults.schedule import FaultSchedule
from virtual_bench.wires.pty_port import PtyPort
from virtual_bench.wires.python_can_port import PythonCanPort
from virtual_bench.wires.slcan_server import SlcanServer

REGISTERS = ModbusProfile(
    profile=ModbusProfileHeader("brake", "modbus"),
    byte_order="big",
    word_order="big",
    identity=IdentityRegister("input", 0, "u16", 0x4C42),
    read=ReadBlock(
        "input", 0, 2, (ReadField("identity", 0, "u16", None, None), ReadField("value", 1, "i16", None, None))
    ),
    write=None,
)


def bench_time() -> BenchTime:
    """Time in which nothing moves."""
    return BenchTime(lambda _ns: None)


def server(time: BenchTime, unit_id: int, value: float, verb: str = "") -> ModbusServer:
    """A device on a line, with a fault that has begun if one is named."""
    faults = [Fault(target="modbus.brake", verb=verb, when=When(time_s=0.0))] if verb else []
    schedule = FaultSchedule(Scenario(scenario=Header(name="line"), faults=tuple(faults)))
    schedule.step(0)
    port = ModbusPort(REGISTERS, unit_id, rtu=True)
    device = Device(port, lambda: {"value": value})
    return ModbusServer("brake", device, time, ModbusFaults(schedule, {"brake": REGISTERS}))


async def asked(line: RtuLine, unit_id: int, timeout_s: float = 0.3) -> list[int] | None:
    """What pymodbus' client gets from a unit of a line; None for silence."""
    client = AsyncModbusSerialClient(await line.start(), baudrate=115200, timeout=timeout_s, retries=0)
    try:
        assert await client.connect()
        reply = await client.read_input_registers(0, count=2, device_id=unit_id)
        return None if reply.isError() else list(reply.registers)
    except ModbusIOException:  # no response
        return None
    finally:
        client.close()
        await line.stop()


def quiet(_kind: str, _text: str) -> None:
    pass


@pytest.mark.parametrize(("unit_id", "found"), [(2, [0x4C42, 17]), (3, [0x4C42, 23]), (4, None)])
def test_each_device_of_a_line_answers_its_own_unit_only(unit_id: int, found: list[int] | None) -> None:
    time = bench_time()
    line = RtuLine([server(time, 2, 17), server(time, 3, 23)], "", quiet, time)
    assert asyncio.run(asked(line, unit_id, 0.3 if found is None else 10.0)) == found


def test_the_bytes_that_a_scan_waits_for_are_those_of_the_line() -> None:
    """Unit, function, count, two registers and check sum: an answer on a line has no header as on TCP."""
    time = bench_time()
    there = server(time, 2, 17)
    assert asyncio.run(asked(RtuLine([there], "", quiet, time), 2)) == [0x4C42, 17]
    assert there.bytes_sent == 1 + 1 + 1 + 2 * 2 + 2


@pytest.mark.parametrize("verb", ["off", "silence", "exception", "truncate", "wrong_unit"])
def test_a_device_with_a_fault_on_its_line_is_not_believed(verb: str) -> None:
    time = bench_time()
    line = RtuLine([server(time, 2, 17, verb)], "", quiet, time)
    assert asyncio.run(asked(line, 2)) is None


def test_a_frozen_device_on_a_line_answers_as_before() -> None:
    time = bench_time()
    line = RtuLine([server(time, 2, 17, "freeze")], "", quiet, time)
    assert asyncio.run(asked(line, 2)) == [0x4C42, 17]


@pytest.fixture
def tmp_path() -> Iterator[Path]:
    """A folder that is not below /dev, where the folders of tests may lie and names of ports are refused."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def test_a_port_has_its_name_until_it_is_closed(tmp_path: Path) -> None:
    link = tmp_path / "can"

    async def use() -> None:
        port = PtyPort(lambda _data: None, str(link))
        assert port.open() == str(link)
        assert os.ttyname(os.open(link, os.O_RDWR | os.O_NOCTTY)) == str(link.resolve())
        port.close()
        port.close()

    asyncio.run(use())
    assert not link.is_symlink()


def test_the_name_left_by_a_bench_that_was_killed_is_taken_over(tmp_path: Path) -> None:
    link = tmp_path / "can"
    link.symlink_to("/dev/pts/nothing")

    async def use() -> None:
        port = PtyPort(lambda _data: None, str(link))
        port.open()
        assert link.exists()
        port.close()

    asyncio.run(use())


@pytest.mark.parametrize(("name", "said"), [("there", "does not exist yet"), ("/dev/ttyUSB9", "for real devices")])
def test_a_name_that_is_taken_or_a_device_is_refused(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / "there").touch()

    async def use() -> None:
        PtyPort(lambda _data: None, str(tmp_path / name)).open()

    with pytest.raises(OSError, match=said):
        asyncio.run(use())
    assert (tmp_path / "there").is_file()


def test_a_frame_after_the_end_of_the_bus_is_nobodys_trouble() -> None:
    """The drive still had something to say when its bus was closed: ValueError, file descriptor -1."""

    async def use() -> None:
        adapter = SlcanServer("", 1_000_000, lambda _id, _data: None, quiet)
        port = PythonCanPort(CanBus("slcan", await adapter.start()), lambda _id, _data: None, quiet)
        await port.start()
        port.send(0x185, b"\x37\x12")
        await port.stop()
        port.send(0x185, b"\x37\x12")
        await port.stop()
        await adapter.stop()

    asyncio.run(use())


def test_a_bus_that_was_closed_under_its_port_is_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []

    def closed(*_args: object, **_options: object) -> None:
        raise ValueError("file descriptor cannot be a negative integer (-1)")  # as python-can's socketcan says it

    port = PythonCanPort(CanBus("virtual", "closed"), lambda _id, _data: None, lambda kind, _text: told.append(kind))
    with can.Bus(interface="virtual", channel="closed") as bus:
        monkeypatch.setattr(bus, "send", closed)
        port._bus = bus
        port.send(0x185, b"")
        port.send(0x185, b"")
    assert told == ["can_send_failed"]
