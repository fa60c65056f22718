"""Nothing in the vocabulary is without an effect, a place where it acts, and a reaction that somebody has seen."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import pytest
from canopen.emcy import EmcyError
from canopen.sdo.exceptions import SdoAbortedError

from definitions.faults import FAULT_BY_ID
from definitions.profiles.modbus import ModbusProfile
from drivers.servo_drive.emcy import EMCY_TEXTS, explain_emcy
from drivers.servo_drive.sdo import SDO_ABORTS, explain_abort
from faultlab.rows import ROWS
from station.bench.assemble import modbus_profile
from station.bench.assemble_virtual import load_scenario
from station.bench.files import FileAt
from station.bench.request import DRIVER_PROFILES
from station.run.faults.machine_faults import DEEDS, Traces
from virtual_bench.devices import pdo_parameters, pdo_service
from virtual_bench.drive import cia402_tables
from virtual_bench.faults.frame_faults import Frame, FrameFaults
from virtual_bench.faults.modbus_faults import ModbusFaults
from virtual_bench.faults.names import VOCABULARY, Vocabulary
from virtual_bench.faults.scenario import Fault, Scenario
from virtual_bench.faults.schedule import FaultSchedule
from virtual_bench.faults.vocabulary import (
    BY_STATION,
    DEVICES,
    FAULTS,
    FRAMES,
    NOT_BY_WALL_CLOCK,
    ONCE,
    ONLY_OVER_WIRES,
    faults_of_devices,
    on_the_wire,
    only_over_wires,
    vocabulary_of,
)

ROOT = Path(__file__).parents[2]
SHIPPED = [load_scenario(path) for path in sorted((ROOT / "scenarios").glob("*.yaml"))]
IN_SCENARIOS = {(fault.target, fault.verb) for scenario in SHIPPED for fault in scenario.faults}
NODE, CONTROLLER = 5, 126
COB_IDS = {
    "can.sync": 0x080,
    "can.setpoint": 0x205,
    "can.controller.heartbeat": 0x77E,
    "can.drive.heartbeat": 0x705,
    "can.drive.tpdo1": 0x185,
    "can.drive.tpdo2": 0x285,
    "can.drive.emcy": 0x085,
    "can.drive.sdo": 0x585,
}
WRITE_6072 = bytes.fromhex("2b 72 60 00 e8 03 00 00")
PROFILES = {"amplifier": "virtual-amplifier", "brake": "virtual-brake", "remote_io": "virtual-remote-io"}
MAPS = {name: modbus_profile(FileAt(DRIVER_PROFILES / f"{file}.yaml")) for name, file in PROFILES.items()}

NOT_IN_THE_MATRIX = {
    "operator_quick_stop": "tests/proofs/golden/golden_runs.py",
    "devices_not_ready": "tests/controller/test_start_and_lock.py",
    "homing_failed": "tests/controller/test_start_and_lock.py",
    "sample_not_ready": "tests/controller/test_debounce.py",
    "calibration_failed": "tests/controller/test_sequence.py",
    "brake_stays_closed": "tests/controller/test_start_and_lock.py",
    "enabling_device_stuck": "tests/controller/test_jog.py",
    "jog_not_stopped": "tests/controller/test_jog.py",
}
"""Faults that no injected fault brings about, and where they are brought about instead."""


PROOFS = {
    ("process.scan", "stop"): Traces(missed=59),
    ("process.scan", "kill"): Traces(scan_died=True),
    ("process.desk", "kill"): Traces(supervisor_killed=True),
    ("machine.disk", "full"): Traces(disk_refused=True),
    ("machine.clock", "step"): Traces(clock_jumped_s=60.1),
}


def schedule(target: str, verb: str, value: float | None, known: Vocabulary = FAULTS) -> FaultSchedule:
    row = known[target, verb]
    given = {"target": target, "verb": verb, "value": value if row.value else None, "when": {"time_s": 0}}
    scenario = {"scenario": {"name": "test"}, "faults": (given,)}
    found = FaultSchedule(Scenario.model_validate(scenario, context={VOCABULARY: known}))
    found.step(0)
    return found


def test_every_fault_has_a_place_where_it_acts() -> None:
    virtual = {(row.target, row.verb) for row in ROWS if row.states}
    wires = {(row.target, row.verb) for row in ROWS if row.wires}
    for key in FAULTS:
        if key in ONLY_OVER_WIRES:
            assert key in wires | IN_SCENARIOS, f"{key}: give its row of the matrix `wires`, or write a scenario"
        else:
            assert key in virtual | IN_SCENARIOS, f"{key}: give it a row of the matrix, or write a scenario"


def test_every_place_is_of_a_fault_that_can_act_there() -> None:
    for row in ROWS:
        key = (row.target, row.verb)
        assert key in FAULTS, row.name
        assert row.states or row.wires, f"{row.name} is never run"
        assert not (row.states and key in ONLY_OVER_WIRES), row.name
        assert not (row.wires and key in NOT_BY_WALL_CLOCK), row.name
        assert set(row.causes) <= set(FAULT_BY_ID), row.name
        assert not row.note or not row.causes, f"{row.name}: a note says why a run may go on"
    assert set(FAULTS) > ONLY_OVER_WIRES | NOT_BY_WALL_CLOCK
    assert not ONLY_OVER_WIRES & NOT_BY_WALL_CLOCK
    assert set(COB_IDS) == set(FRAMES)


FRAME_ROWS = [key for key in FAULTS if on_the_wire(*key) and key[0].startswith("can.")]


@pytest.mark.parametrize(("target", "verb"), FRAME_ROWS)
def test_every_fault_of_frames_changes_what_arrives(target: str, verb: str) -> None:
    value = {"lie": 0x6072, "abort": 0x08000021, "drop": 1.0}.get(verb, 2.0)
    faults = schedule(target, verb, value)
    frames = FrameFaults(faults, NODE, CONTROLLER)
    sent = [(COB_IDS.get(target, 0x080), bytes([n, 0, 7, 1])) for n in range(4)]
    arrived = [frame for cob_id, data in sent for frame in frames.pass_on(cob_id, data)]
    untouched = [(0, cob_id, data) for cob_id, data in sent]
    answered = frames.answered(0x605, WRITE_6072)
    told = frames.port_is_cut() or frames.error_frames()
    assert arrived != untouched or answered is not None or told
    assert faults.unseen() == []


MODBUS_ROWS = [key for key in FAULTS if key[0].startswith("modbus.")]


@pytest.mark.parametrize(("target", "verb"), MODBUS_ROWS)
def test_every_fault_of_modbus_answers_changes_them(target: str, verb: str) -> None:
    assert target.split(".")[1] in DEVICES
    answers_change(target, verb, MAPS, FAULTS)


def answers_change(target: str, verb: str, maps: Mapping[str, ModbusProfile], known: Vocabulary) -> None:
    device = target.split(".")[1]
    registers = maps[device]
    faults = schedule(target, verb, 2.0, known)
    modbus = ModbusFaults(faults, maps)
    out, sent = [], []
    for number in range(1, 4):
        request = number.to_bytes(2, "big") + bytes.fromhex("0000 0006 01 04 0000") + bytes([0, registers.read.count])
        words = bytes(17 * number + place & 0xFF for place in range(2 * registers.read.count))
        response = number.to_bytes(2, "big") + bytes([0, 0, 0, 3 + len(words), 1, 4, len(words)]) + words
        sent.append((0.0, response))
        pieces = modbus.in_place(device, request)
        out += modbus.answer(device, request, response) if pieces is None else pieces
    assert out != sent or modbus.is_cut(device) or modbus.takes_reset(device)
    assert faults.unseen() == []


SENSOR = {"flange": 0x18B, "flange.heartbeat": 0x70B}
NAMED = faults_of_devices({"torques": [field.name for field in MAPS["amplifier"].read.fields]}, {"flange": True})


@pytest.mark.parametrize(("target", "verb"), [key for key in NAMED if key[0].startswith("can.")])
def test_every_fault_of_a_named_sensor_changes_what_arrives(target: str, verb: str) -> None:
    faults = schedule(target, verb, 1.0, NAMED)
    frames = FrameFaults(faults, NODE, CONTROLLER)
    frames.add_sensor("flange", [SENSOR["flange"]], SENSOR["flange.heartbeat"] - 0x700)
    of_another = [Frame(0, 0x18C, bytes([n])) for n in range(4)]
    assert [frame for sent in of_another for frame in frames.pass_on(sent.cob_id, sent.data)] == of_another
    sent = [Frame(0, SENSOR.get(target.removeprefix("can."), 0x18B), bytes([n, 0, 7, 1])) for n in range(4)]
    arrived = [frame for one in sent for frame in frames.pass_on(one.cob_id, one.data)]
    assert (arrived != sent) == (verb != "reset")
    assert frames.takes_reset("flange") == (verb == "reset")
    assert not frames.takes_reset("flange"), "once"
    assert faults.unseen() == []


@pytest.mark.parametrize(("target", "verb"), [key for key in NAMED if key[0].startswith("modbus.")])
def test_every_fault_of_a_named_device_changes_its_answers(target: str, verb: str) -> None:
    answers_change(target, verb, {"torques": MAPS["amplifier"]}, NAMED)


def test_what_one_bench_can_do_is_named_by_its_devices_and_nothing_else() -> None:
    both = vocabulary_of({"torques": MAPS["amplifier"], "brake": MAPS["brake"]}, {"box": False})
    targets = {target for target, _ in both}
    assert {"modbus.torques", "modbus.torques.sample_counter", "modbus.brake", "can.box", "sensor.angle_in"} <= targets
    lacking = ("modbus.amplifier", "modbus.amplifier.sample_counter", "can.box.node", "can.box.heartbeat")
    assert not targets & set(lacking)
    assert set(FAULTS) < set(vocabulary_of(MAPS, {"box": True}))
    assert all(only_over_wires(*key) == (key in ONLY_OVER_WIRES) for key in FAULTS)
    assert all(only_over_wires(*key) for key in NAMED)


def test_an_undisturbed_wire_passes_everything_on() -> None:
    quiet = FaultSchedule(None)
    assert FrameFaults(quiet, NODE, CONTROLLER).pass_on(0x185, b"\1\2") == [Frame(0, 0x185, b"\1\2")]
    assert ModbusFaults(quiet, MAPS).in_place("brake", b"\0" * 12) is None
    assert ModbusFaults(quiet, MAPS).answer("brake", b"\0" * 12, b"\1" * 12) == [(0.0, b"\1" * 12)]


@pytest.mark.parametrize(("verb", "value", "heard"), [("command", None, [0x205]), ("babble", 3.0, [0x7E5] * 3)])
def test_frames_of_others_come_with_each_sync_and_are_for_the_controller(verb, value, heard) -> None:
    fault = Fault(target="can.bus", verb=verb, value=value, when={"state": "lock"})
    found = FaultSchedule(Scenario(scenario={"name": "test"}, faults=(fault,)))
    found.tell("lock", 10)
    found.step(0)
    bus = FrameFaults(found, NODE, CONTROLLER)
    assert bus.pass_on(0x185, b"\1") == [Frame(0, 0x185, b"\1")]
    sync, *others = bus.pass_on(0x080, b"")
    assert sync == Frame(0, 0x080, b"")
    assert [frame.cob_id for frame in others] == heard
    assert all(frame.of_another for frame in others)
    assert found.unseen() == []


def test_what_the_station_does_is_left_to_it() -> None:
    assert set(DEEDS) == BY_STATION > ONCE
    assert BY_STATION < ONLY_OVER_WIRES
    when = {"state": "lock"}
    faults = [
        Fault(target=key[0], verb=key[1], value=5.0 if FAULTS[key].value else None, when=when) for key in BY_STATION
    ]
    scenario = Scenario(scenario={"name": "test"}, faults=tuple(faults))
    found = FaultSchedule(scenario)
    found.tell("lock", 10)
    found.step(0)
    assert not found.active
    assert found.unseen() == []


@pytest.mark.parametrize(("key", "traces"), PROOFS.items(), ids=lambda item: " ".join(item) if item in PROOFS else "")
def test_every_fault_of_the_machine_is_proven_by_what_it_leaves_and_by_nothing_else(key, traces) -> None:
    assert set(PROOFS) == BY_STATION
    value = 60.0
    assert DEEDS[key].proof(traces, value)
    assert not DEEDS[key].proof(Traces(), value)
    for other, left in PROOFS.items():
        explains = key == ("process.scan", "stop") and other == ("process.scan", "kill")  # stopped until it died
        assert DEEDS[key].proof(left, value) == (other == key or explains)


def test_a_few_periods_that_any_machine_misses_do_not_prove_a_stop() -> None:
    deed = DEEDS["process.scan", "stop"]
    assert not deed.proof(Traces(missed=3), 60.0)
    assert not deed.proof(Traces(missed=11, period_ms=4.0), 60.0)
    assert deed.proof(Traces(missed=12, period_ms=4.0), 60.0)
    assert not deed.proof(Traces(missed=0), 0.5)


def test_a_clock_that_jumped_otherwise_proves_nothing() -> None:
    deed = DEEDS["machine.clock", "step"]
    assert not deed.proof(Traces(clock_jumped_s=-60.0), 60.0)
    assert not deed.proof(Traces(), 0.0), "a step by nothing is none"


def test_every_fault_of_the_controller_has_been_brought_about() -> None:
    """By a fault at a device, by a scenario, or by a channel that shows a value beyond its limit."""
    pages = [(ROOT / "docs" / name).read_text("utf-8") for name in ("fault-matrix.md", "wire-faults.md")]
    cells = [line.split("|")[3].strip() for page in pages for line in page.splitlines() if line.startswith("| `")]
    scenarios = {expect.event for scenario in SHIPPED for expect in scenario.expect}
    exits = (ROOT / "docs" / "exits.md").read_text("utf-8")
    shown = {line.split("`")[1] for line in exits.splitlines() if line.startswith("| `") and " shown beyond " in line}
    assert set(FAULT_BY_ID) - set(cells) - scenarios - shown == set(NOT_IN_THE_MATRIX)
    for name, file in NOT_IN_THE_MATRIX.items():
        assert re.search(rf"\b{name}\b", (ROOT / file).read_text("utf-8")), f"{name} is not in {file}"


def test_every_abort_that_canopen_knows_has_a_hint() -> None:
    assert set(SdoAbortedError.CODES) <= set(SDO_ABORTS)
    ours = {value for name, value in vars(pdo_parameters).items() if name.startswith("ABORT_")}
    assert ours
    for code in ours:
        assert explain_abort(code) is SDO_ABORTS[code]


def test_every_emergency_that_canopen_knows_or_our_drive_sends_has_a_hint() -> None:
    for code, _mask, _text in EmcyError.DESCRIPTIONS:
        assert not explain_emcy(code).cause.startswith("unknown")
    ours = (
        cia402_tables.COMMUNICATION_LOST,
        cia402_tables.HEARTBEAT_LOST,
        cia402_tables.SETPOINT_TIMEOUT,
        pdo_service.LENGTH_SHORT,
        pdo_service.LENGTH_LONG,
    )
    injected = [round(fault.value) for row in SHIPPED for fault in row.faults if fault.target == "drive.emcy"]
    for code in (*ours, *injected, *(round(row.value) for row in ROWS if row.target == "drive.emcy")):
        assert code in EMCY_TEXTS, hex(code)
