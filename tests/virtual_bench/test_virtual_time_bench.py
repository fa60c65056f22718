"""The in-process bench: latency of the wires, ages, faults, and the same bytes from the same seed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from pydantic import ValidationError

from definitions.image import (
    AGE_NEVER,
    DriveCommand,
    DriveMode,
    DriveState,
    Image,
    Link,
    Orders,
    Reaction,
    State,
)
from virtual_bench.config import BenchConfig
from virtual_bench.errors import VirtualBenchError
from virtual_bench.faults.scenario import Scenario
from virtual_bench.faults.vocabulary import FAULTS, ONLY_OVER_WIRES
from virtual_bench.in_process import CONTROLWORDS, VirtualTimeBench
from virtual_bench.physics.find_unit import DEFAULT_UNITS, default_unit, find_unit
from virtual_bench.physics.units import SPREAD, UNITS, parameters

PERIOD_NS = 1_000_000


def orders(command: DriveCommand, torque_nm: float = 0.0, brake_a: float = 0.0) -> Orders:
    return Orders(
        drive_command=int(command),
        drive_mode=int(DriveMode.CYCLIC_SYNC_TORQUE),
        drive_target_torque_nm=torque_nm,
        drive_target_velocity_rad_s=0.0,
        brake_on=int(brake_a > 0.0),
        brake_current_a=brake_a,
        state=int(State.IDLE),
        phase=0,
        segment=0,
        cycle=0,
        reaction=int(Reaction.NONE),
        fault=0,
        alarms=0,
        reference_torque_nm=0.0,
        controlled_torque_nm=0.0,
        torque_in_tare_nm=0.0,
        torque_out_tare_nm=0.0,
        angle_in_zero_rad=0.0,
        angle_out_zero_rad=0.0,
    )


class Scans:
    """Scans one after another on a bench."""

    def __init__(self, config: BenchConfig, faults: list[dict[str, Any]] | None = None) -> None:
        scenario = None
        if faults is not None:
            scenario = Scenario.model_validate({"scenario": {"name": "test"}, "faults": faults})
        self.bench = VirtualTimeBench(config, PERIOD_NS, scenario)
        self.scan = 0

    def run(self, count: int, what: Orders) -> Image:
        for _ in range(count):
            image = self.bench.read(self.scan, self.bench.faults.take_missed(), 0)._replace()
            self.bench.write(what, self.scan)
            self.scan += 1
        return image

    def ramp(self, torque_nm: float) -> Image:
        """Enable, lock and ramp the motor torque at 4 N·m/s."""
        for command in (DriveCommand.SHUTDOWN, DriveCommand.SWITCH_ON):
            self.run(2, orders(command, brake_a=6.0))
        image = self.run(500, orders(DriveCommand.ENABLE_OPERATION, brake_a=6.0))
        assert image.drive_state == DriveState.OPERATION_ENABLED
        for step in range(1, round(torque_nm / 0.004) + 1):
            image = self.run(1, orders(DriveCommand.ENABLE_OPERATION, 0.004 * step, 6.0))
        return image


def test_latency_and_ages_are_those_of_the_wires(bench_config: BenchConfig) -> None:
    scans = Scans(bench_config)
    idle = orders(DriveCommand.DISABLE_VOLTAGE)
    first = scans.run(1, idle)
    assert first.drive_age_scans == first.sample_age_scans == first.io_age_scans == AGE_NEVER
    assert first.drive_state == DriveState.UNKNOWN
    second = scans.run(1, orders(DriveCommand.SHUTDOWN))
    assert second.drive_age_scans == second.sample_age_scans == second.brake_age_scans == 0
    assert second.drive_state == DriveState.SWITCH_ON_DISABLED
    third = scans.run(1, idle)
    assert third.drive_state == DriveState.READY_TO_SWITCH_ON
    ages = [scans.run(1, idle).io_age_scans for _ in range(20)]
    assert max(ages) == 9
    assert ages.count(0) == 2


def test_a_position_at_the_end_of_its_32_bits_goes_on_as_any_other(bench_config: BenchConfig) -> None:
    def turned_rad(begin_counts: int) -> float:
        scans = Scans(bench_config)
        machine = scans.bench.axis.machine
        machine.motion.home_counts = machine.motor.position_counts - begin_counts
        begin = scans.run(3, orders(DriveCommand.DISABLE_VOLTAGE))
        return scans.ramp(1.0).drive_angle_rad - begin.drive_angle_rad

    plain = turned_rad(0)
    assert plain > 1e-3
    assert turned_rad(2**31 - 2) == pytest.approx(plain, abs=1e-6)


def test_missed_periods_pass_for_the_plant_too(bench_config: BenchConfig) -> None:
    scans = Scans(bench_config)
    idle = orders(DriveCommand.DISABLE_VOLTAGE)
    before = scans.run(2, idle).sample_counter
    scans.bench.read(2, 4, 0)
    scans.bench.write(idle, 2)
    assert scans.bench.read(3, 0, 0).sample_counter - before == 60


def test_torque_reaches_the_sensor(bench_config: BenchConfig) -> None:
    image = Scans(bench_config).ramp(4.0)
    assert image.torque_in_nm == pytest.approx(4.0, abs=0.03)
    assert image.torque_out_nm == pytest.approx(-13.9 + 94.7 * 4.0, abs=4.0)
    assert image.drive_torque_nm == pytest.approx(4.0, abs=0.02)
    assert image.drive_follows_command == 1
    assert image.drive_internal_limit == 0
    assert image.brake_current_a == 6.0


def test_the_torque_limit_shows(bench_config: BenchConfig) -> None:
    assert Scans(bench_config).ramp(5.6).drive_internal_limit == 1


def test_same_seed_same_images(bench_config: BenchConfig) -> None:
    first, second = Scans(bench_config), Scans(bench_config)
    what = orders(DriveCommand.DISABLE_VOLTAGE)
    for _ in range(200):
        assert first.run(1, what) == second.run(1, what)
    assert first.bench.plant.state.tobytes() == second.bench.plant.state.tobytes()


def test_every_drive_command_has_a_controlword() -> None:
    assert set(CONTROLWORDS) == set(DriveCommand)


ABOVE = {"torque_out_above_nm": 150.0}
LOST = {
    "modbus.amplifier": (Link.AMPLIFIER, "sample_age_scans"),
    "modbus.brake": (Link.BRAKE, "brake_age_scans"),
    "modbus.remote_io": (Link.REMOTE_IO, "io_age_scans"),
}


@pytest.mark.parametrize("target", sorted(LOST))
def test_a_cut_connection_is_lost_and_its_values_age(bench_config: BenchConfig, target: str) -> None:
    scans = Scans(bench_config, [{"target": target, "verb": "off", "when": ABOVE}])
    image = scans.ramp(2.4)
    link, age = LOST[target]
    assert image.links_lost == link
    assert getattr(image, age) > 20
    assert [acted.fault.target for acted in scans.bench.faults.acted] == [target]
    assert scans.bench.faults.unseen() == []


def test_the_heartbeat_stops(bench_config: BenchConfig) -> None:
    scans = Scans(bench_config, [{"target": "can.drive.heartbeat", "verb": "off", "when": ABOVE}])
    assert scans.ramp(2.6).drive_heartbeat_age_scans > 50
    assert scans.bench.faults.acted


def test_the_status_stops(bench_config: BenchConfig) -> None:
    scans = Scans(bench_config, [{"target": "can.drive.tpdo1", "verb": "off", "when": ABOVE}])
    assert scans.ramp(2.4).drive_age_scans > 20


def test_the_lock_slips(bench_config: BenchConfig) -> None:
    scans = Scans(bench_config, [{"target": "lock", "verb": "slip", "value": 0.1, "when": ABOVE}])
    before = scans.run(2, orders(DriveCommand.DISABLE_VOLTAGE)).angle_out_rad
    scans.ramp(2.4)
    image = scans.run(300, orders(DriveCommand.ENABLE_OPERATION, 2.4, 6.0))
    assert abs(image.angle_out_rad - before) > 1e-3
    assert image.torque_out_nm < 80.0


def test_the_emergency_stop_takes_the_torque(bench_config: BenchConfig) -> None:
    scans = Scans(bench_config, [{"target": "io.estop", "verb": "trip", "when": ABOVE}])
    image = scans.ramp(2.4)
    assert image.estop_released == 0
    assert image.drive_state == DriveState.SWITCH_ON_DISABLED
    assert image.drive_torque_nm == 0.0


def test_the_guard_opens(bench_config: BenchConfig) -> None:
    scans = Scans(bench_config, [{"target": "io.guard", "verb": "open", "when": ABOVE}])
    assert scans.ramp(2.4).guard_closed == 0


def test_the_drive_faults_with_its_code(bench_config: BenchConfig) -> None:
    scans = Scans(bench_config, [{"target": "drive.emcy", "verb": "raise", "value": 0x7121, "when": {"time_s": 0.2}}])
    image = scans.run(150, orders(DriveCommand.DISABLE_VOLTAGE))
    assert image.drive_state == DriveState.FAULT
    assert image.drive_emcy_code == 0x7121
    assert image.drive_error_register == 0x21


@pytest.mark.parametrize(("verb", "value"), [("stuck", None), ("offset", 100.0)])
def test_a_sensor_lies(bench_config: BenchConfig, verb: str, value: float | None) -> None:
    scans = Scans(bench_config, [{"target": "sensor.torque_out", "verb": verb, "value": value, "when": ABOVE}])
    image = scans.ramp(4.0)
    truth = -13.9 + 94.7 * 4.0
    assert image.torque_out_nm == pytest.approx(150.0 if value is None else truth + value, abs=5.0)


def test_a_fault_that_never_acts_is_named(bench_config: BenchConfig) -> None:
    scans = Scans(bench_config, [{"target": "io.guard", "verb": "open", "when": {"time_s": 1e6}}])
    scans.run(10, orders(DriveCommand.DISABLE_VOLTAGE))
    assert [fault.target for fault in scans.bench.faults.unseen()] == ["io.guard"]


def test_a_controller_that_stops_loses_the_drive(bench_config: BenchConfig) -> None:
    scans = Scans(bench_config)
    scans.ramp(1.0)
    for _ in range(60):
        scans.bench.read(scans.scan, 0, 0)
        scans.scan += 1
    assert scans.bench.axis.machine.error_code == 0x8250
    assert scans.bench.axis.machine.state.text == "switch on disabled"


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ({"target": "io.door", "verb": "open", "when": ABOVE}, "allowed: brake.current, can.bus"),
        ({"target": "io.guard", "verb": "shut", "when": ABOVE}, "allowed: open"),
        ({"target": "lock", "verb": "slip", "when": ABOVE}, "needs value"),
        ({"target": "lock", "verb": "slip", "value": 2, "when": ABOVE}, "from 0 to 1"),
        ({"target": "io.guard", "verb": "open", "value": 1, "when": ABOVE}, "takes no value"),
        ({"target": "io.guard", "verb": "open", "when": {}}, "exactly one"),
        ({"target": "io.guard", "verb": "open", "whan": {}}, "whan"),
    ],
)
def test_a_wrong_scenario_is_refused_with_what_is_allowed(fault: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Scenario.model_validate({"scenario": {"name": "wrong"}, "faults": [fault]})


IN_VIRTUAL_TIME = sorted(set(FAULTS) - ONLY_OVER_WIRES)


@pytest.mark.parametrize(("target", "verb"), IN_VIRTUAL_TIME)
def test_every_fault_of_the_vocabulary_acts(bench_config: BenchConfig, target: str, verb: str) -> None:
    row = FAULTS[target, verb]
    value = 0.5 if target in {"lock", "brake.current", "unit"} else 0x8311 if target == "drive.emcy" else 2.0
    fault = {"target": target, "verb": verb, "when": {"time_s": 0.15}}
    others = [EMERGENCY] if target == "can.drive.emcy" else []
    scans = Scans(bench_config, [fault | ({"value": max(min(value, row.high), row.low)} if row.value else {}), *others])
    for command in (DriveCommand.DISABLE_VOLTAGE, DriveCommand.SHUTDOWN, DriveCommand.SWITCH_ON):
        scans.run(50, orders(command, brake_a=1.0))
    for step in range(200):
        scans.run(1, orders(DriveCommand.ENABLE_OPERATION, 0.004 * step, 6.0))
    scans.run(3, orders(DriveCommand.ENABLE_OPERATION)._replace(drive_mode=DriveMode.CYCLIC_SYNC_VELOCITY))
    assert scans.bench.faults.unseen() == []


EMERGENCY = {"target": "drive.emcy", "verb": "raise", "value": 0x7121, "when": {"time_s": 0.2}}


def test_units_are_found_varied_and_refused(bench_config: BenchConfig) -> None:
    assert default_unit("RV-40E-121") == "P1"
    assert all(UNITS[name].model == model for model, name in DEFAULT_UNITS.items())
    assert find_unit("P1:3") == find_unit("P1:3") != find_unit("P1:4")
    assert set(SPREAD) < set(parameters(UNITS["P1"]))
    base, varied = parameters(find_unit("P1")), parameters(find_unit("P1:3"))
    for name, value in base.items():
        assert abs(varied[name] - value) <= SPREAD.get(name, 0.0) * abs(value) + 1e-15
    assert max(SPREAD.values()) <= 0.20
    with pytest.raises(VirtualBenchError, match="nearest: worn"):
        find_unit("wron")
    with pytest.raises(VirtualBenchError, match="whole number"):
        find_unit("P1:x")
    assert default_unit("RV-80") == "catalogue"
    with pytest.raises(VirtualBenchError, match=r"'catalogue'.*recipe"):
        find_unit("catalogue:2")
    with pytest.raises(VirtualBenchError):
        VirtualTimeBench(replace(bench_config, unit="none"), PERIOD_NS)
