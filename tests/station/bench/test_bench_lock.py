from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.config import CanConfig
from recipes import find_bench, load_bench
from recipes.schema.device_schema import ModbusDevice
from station.bench import bench_lock
from station.bench.assemble import can_config, wire_config
from station.bench.bench_lock import BenchBusyError, alone_on, can_lock, modbus_lock
from station.bench.files import FileAt
from station.bench.request import find_profile
from station.commissioning.on_wires import on_wires
from station.own_place import PLACE

ROOT = Path(__file__).parents[3]


NAME = "bench 1"


def _can() -> CanConfig:
    return can_config(load_bench("example-socketcan"))


def _brake() -> ModbusDevice:
    brake = load_bench("example-socketcan").brake
    assert brake is not None
    return brake


def _device(unit_id: int = 1, host: str = "127.0.0.1", serial_port: str = "") -> ModbusDevice:
    place = {"transport": "rtu", "serial_port": serial_port} if serial_port else {"transport": "tcp", "host": host}
    return _brake().model_copy(update=place | {"unit_id": unit_id})


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PLACE, str(tmp_path / "own"))


def test_a_bench_has_one_controller_at_a_time() -> None:
    can = _can()
    with (
        alone_on(NAME, can),
        pytest.raises(BenchBusyError, match=f"in use by process {os.getpid()}"),
        alone_on(NAME, can),
    ):
        pass
    with alone_on(NAME, can):
        pass


def test_other_wires_are_another_bench() -> None:
    can = _can()
    other = replace(can, channel="can7")
    assert can_lock(can) != can_lock(other)
    with alone_on(NAME, can), alone_on(NAME, other):
        pass


def test_a_server_is_named_by_its_address_and_one_without_by_what_is_written() -> None:
    server = CanConfig("socketcand", "can0", "127.0.0.1", 29536)
    assert can_lock(server) == can_lock(replace(server, host="localhost"))
    places = [server, replace(server, host="127.0.0.2"), replace(server, port=29537), replace(server, channel="can1")]
    unknown = [replace(server, host=host) for host in ("No-Such-Host.invalid", "a..b", "x" * 70)]
    assert can_lock(unknown[0]) == can_lock(replace(server, host="no-such-host.invalid"))
    assert len({can_lock(one) for one in (*places, *unknown)}) == 7


def test_a_name_server_that_is_silent_holds_nobody_up(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = bench_lock._first_address
    answered = threading.Event()

    def silent(host: str, flags: int = 0) -> str:
        if not flags:
            assert answered.wait(60.0)
        return asked(host, flags)

    monkeypatch.setattr(bench_lock, "_first_address", silent)
    monkeypatch.setattr(bench_lock, "LONGEST_LOOKUP_S", 0.05)
    path = can_lock(CanConfig("socketcand", "can0", "silent.invalid"))
    answered.set()
    assert "silent.invalid" in path.name


def test_a_native_interface_is_named_by_its_channel_alone() -> None:
    can = CanConfig("socketcan", "can0", "127.0.0.1", 29536)
    assert can_lock(can) == can_lock(replace(can, host="192.168.0.9", port=1))
    assert can_lock(can) != can_lock(replace(can, channel="can1"))


def test_a_serial_port_is_named_by_the_device_behind_its_link(tmp_path: Path) -> None:
    port, link = tmp_path / "ttyACM0", tmp_path / "usb-by-id"
    port.touch()
    link.symlink_to(port)
    adapter = CanConfig("slcan", str(port), serial_port=str(port))
    assert can_lock(adapter) == can_lock(replace(adapter, channel=str(link), serial_port=str(link)))
    assert modbus_lock(_device(serial_port=str(port))) == modbus_lock(_device(serial_port=str(link)))
    line = modbus_lock(_device(serial_port=str(port)))
    assert line == modbus_lock(_device(2, serial_port=str(port))), "a serial line has one master"


def test_two_benches_share_a_gateway_but_no_device() -> None:
    can, other = _can(), replace(_can(), channel="can7")
    brake = _device(3)
    with alone_on(NAME, can, [_device(1), brake]):
        with alone_on("bench 2", other, [_device(2)]):
            pass
        for shared in (_device(3, host="localhost"), brake):
            held = f"Modbus {shared.line} unit 3.* in use by process {os.getpid()}"
            with pytest.raises(BenchBusyError, match=held), alone_on("bench 2", other, [_device(2), shared]):
                pass
        with alone_on("bench 2", other, [_device(2)]):
            pass  # nothing was kept of what could be had
    with alone_on("bench 2", other, [brake]):
        pass


def test_one_device_of_several_blocks_is_held_once_and_all_in_one_order(monkeypatch: pytest.MonkeyPatch) -> None:
    taken, held = list[str](), bench_lock._held
    monkeypatch.setattr(bench_lock, "_held", lambda path, *names: taken.append(path.name) or held(path, *names))
    devices = [_device(2), _device(1), _device(1), _device(1, host="localhost")]
    for order in (devices, devices[::-1]):
        with alone_on(NAME, _can(), order):
            pass
    assert len(taken) == 6
    assert taken[:3] == taken[3:] == sorted(taken[:3])


def test_the_devices_of_a_bench_are_all_held_by_its_scan() -> None:
    bench = load_bench("example-channels")
    files = {name: FileAt(find_profile(name, find_bench("example-channels"))) for name in bench.profile_names}
    wires = wire_config(bench, files, 1_000_000, None)
    assert {modbus_lock(one) for one in wires.modbus} == {modbus_lock(one) for one in bench.modbus_devices.values()}


def test_a_step_of_commissioning_holds_the_devices_as_a_scan_does() -> None:
    other = CanConfig("socketcan", "can7")
    with alone_on(NAME, other, [_brake()]), pytest.raises(BenchBusyError), on_wires("example-socketcan").alone():
        pass


def test_no_other_user_can_hold_the_lock() -> None:
    can = _can()
    with alone_on(NAME, can):
        path = can_lock(can)
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700


def test_a_place_that_others_may_enter_is_refused() -> None:
    can = _can()
    with alone_on(NAME, can):
        pass
    can_lock(can).parent.chmod(0o755)
    with pytest.raises(BenchBusyError, match="mode 0755; allowed is 0700"), alone_on(NAME, can):
        pass


def test_a_link_in_place_of_the_lock_is_followed_by_nobody(tmp_path: Path) -> None:
    can, target = _can(), tmp_path / "target"
    target.write_text("as it was")
    can_lock(can).symlink_to(target)
    with pytest.raises(BenchBusyError, match="cannot be opened"), alone_on(NAME, can):
        pass
    assert target.read_text() == "as it was"


@pytest.mark.wires
@pytest.mark.parametrize("shared", ["bus", "brake"])
def test_a_second_run_on_a_bench_is_refused(tmp_path: Path, shared: str) -> None:
    with alone_on(NAME, _can()) if shared == "bus" else alone_on(NAME, CanConfig("socketcan", "can7"), [_brake()]):
        words = ["run", "rv-40e-121-quick", "--serial", "SN1", "--bench", "example-socketcan", "--json"]
        words += ["--data", str(tmp_path)]
        done = subprocess.run(
            [sys.executable, "-m", "station", *words], cwd=ROOT, text=True, capture_output=True, check=False
        )
    assert done.returncode == 4, done.stderr
    result = json.loads(done.stdout)
    assert result["verdict"] == "NOT DECIDABLE"
    assert f"in use by process {os.getpid()}" in " ".join(result["reasons"])
