"""The controller still decides as it did in the golden runs; a changed one shows the first scan that differs."""

from __future__ import annotations

from dataclasses import replace as with_change
from functools import cache

import pytest
from golden_file import MAKE_ANEW, read_golden
from golden_runs import FOLDER, GOLDEN_RUNS, Golden, job, program_of

import controller.interlocks
from controller.controller import Controller
from controller.interlocks import INTERLOCKS
from definitions.faults import FAULT_BY_ID
from definitions.image import State
from station.records.samples.check import check_bytes
from station.records.samples.event_log import state_name
from station.records.samples.table import table_of
from station.results.replay import replay

BY_NAME = {golden.name: golden for golden in GOLDEN_RUNS}
MOST_BYTES = 300_000


@cache
def program():
    return job().program


@cache
def content(name: str) -> bytes:
    base = b"" if name == GOLDEN_RUNS[0].name else content(GOLDEN_RUNS[0].name)
    return read_golden(BY_NAME[name].path, base)


@pytest.mark.parametrize("golden", GOLDEN_RUNS, ids=lambda golden: golden.name)
def test_controller_decides_as_it_did(golden: Golden):
    found = replay(content(golden.name), Controller(program_of(golden, job())))
    shown = "" if found.difference is None else "\n".join(found.difference.lines(4_000_000))
    assert found.same, f"{golden.name}: {found.damage}{shown}\n{MAKE_ANEW}"


@pytest.mark.parametrize("golden", GOLDEN_RUNS, ids=lambda golden: golden.name)
def test_golden_run_is_sound_and_ends_as_its_table_says(golden: Golden):
    assert check_bytes(content(golden.name)).sound
    orders = table_of(content(golden.name))["orders"]
    assert state_name(orders["state"][-1]) == golden.end
    number = FAULT_BY_ID[golden.cause].number if golden.cause else 0
    assert orders["fault"][-1] == number


def test_golden_runs_go_through_every_state():
    seen = set()
    for golden in GOLDEN_RUNS:
        seen |= {State(state) for state in table_of(content(golden.name))["orders"]["state"]}
    assert seen == set(State)


def test_golden_runs_are_small_and_none_is_left_over():
    files = set(FOLDER.glob("*.golden.xz"))
    assert files == {golden.path for golden in GOLDEN_RUNS}
    assert sum(path.stat().st_size for path in files) < MOST_BYTES


@pytest.mark.parametrize(
    "name",
    [golden.name for golden in GOLDEN_RUNS if golden.cause in {row.fault for row in INTERLOCKS}],
)
def test_an_interlock_that_was_taken_out_is_caught_at_its_scan(name, monkeypatch):
    fault = BY_NAME[name].cause
    rest = tuple(row for row in INTERLOCKS if row.fault != fault)
    monkeypatch.setattr(controller.interlocks, "INTERLOCKS", rest)
    found = replay(content(name), Controller(program()))
    tripped = int(table_of(content(name))["scan"][(table_of(content(name))["orders"]["fault"] != 0).argmax()])
    assert found.difference is not None
    assert found.difference.scan <= tripped


@pytest.mark.parametrize(
    ("name", "limit", "factor"),
    [
        ("torque-sensor-offset", "torque_out_trip_nm", 2.0),
        ("normal", "torque_out_alarm_nm", 0.8),
        ("normal", "torque_in_trip_nm", 0.2),
        ("normal", "speed_rad_s", 0.01),
        ("normal", "lock_slip_rad", 0.01),
        ("heartbeat-lost", "heartbeat_scans", 2),
        ("process-data-lost", "drive_stale_scans", 2),
        ("periods-missed", "missed_in_a_row", 2),
    ],
)
def test_a_changed_interlock_limit_is_caught_with_both_sides(name, limit, factor):
    limits = program().limits
    changed = with_change(limits, **{limit: type(getattr(limits, limit))(getattr(limits, limit) * factor)})
    found = replay(content(name), Controller(with_change(program(), limits=changed)))
    assert found.difference is not None
    differing = {pair.name for pair in found.difference.pairs() if pair.differs}
    assert "alarms" in differing
    shown = "\n".join(found.difference.lines(4_000_000))
    assert f"scan {found.difference.scan}" in shown
    assert "* alarms" in shown
