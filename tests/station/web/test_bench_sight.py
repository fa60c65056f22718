"""What a record shows of a bench; the steps of the recovery; what has changed and what is due: by tables, pure."""

from __future__ import annotations

import dataclasses
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from patient import VIRTUAL_BENCH, write_changed
from station_samples import SETUP
from station_support import GOLDEN

from benchmarks.many_runs import make_runs
from definitions.faults import FAULTS, Beyond, bit_of
from definitions.first_image import first_image
from definitions.image import AGE_NEVER, IMAGE_FIELDS, ORDERS_FIELDS, Image, Link, Orders, State
from definitions.program import Program
from station.bench.request import load_job
from station.records.data_folder import Store
from station.records.samples.scan_record import pack
from station.run.way_back.guide import UNPROVEN_DRIVE
from station.web.bench.changes import IN_PROGRESS, RunFacts, changes_between, since_it_worked
from station.web.bench.due import due_on
from station.web.bench.sight import DEVICES, Sight, device_of, sight_of
from station.web.bench.way_back import DONE, IN_HAND, IN_THE_WAY, TO_COME, Fault, Standing, steps
from station.web.models import load_models

SETTLED = 4
NO_ORDERS = Orders(*(0 for _ in ORDERS_FIELDS))
FRESH: Image = first_image()._replace(
    sample_age_scans=1, drive_age_scans=0, brake_age_scans=3, io_age_scans=3, drive_heartbeat_age_scans=5,
    estop_released=1, guard_closed=1, links_lost=0, torque_out_nm=20.0, brake_on=1, brake_current_a=6.0,
)  # fmt: skip


@pytest.fixture(scope="module")
def program() -> Program:
    return load_job(str(GOLDEN), None).program


def seen(program: Program, orders: Orders = NO_ORDERS, **image: float) -> Sight:
    return sight_of(pack((0, 0, 0, 0), FRESH._replace(**image), orders), program)


def test_every_field_of_the_process_image_is_shown_once(program: Program) -> None:
    found = seen(program)
    shown = [one.field for device in found.devices for one in device.readings]
    ages = {row.age for row in DEVICES if row.age}
    assert sorted([*shown, *ages]) == sorted(field.name for field in IMAGE_FIELDS)
    assert [one.field for one in found.outputs] == [field.name for field in ORDERS_FIELDS]
    assert all(device_of(name) != "Controller" for name in ages)


def test_every_limit_of_the_fault_table_is_shown_nearest_first(program: Program) -> None:
    limited = {fault.id for fault in FAULTS if fault.limit and fault.limit.channel}
    rows = seen(program, NO_ORDERS._replace(state=State.RAMP_POS), torque_out_nm=400.0).limits
    assert {row.fault for row in rows} == limited, "the golden bench has every sensor"
    shares = [row.share for row in rows if row.watched]
    assert shares == sorted(shares, reverse=True)
    assert rows[0].near
    assert rows[0].fault in ("torque_out_alarm", "torque_out_trip")


@pytest.mark.parametrize("fault", [one for one in FAULTS if one.limit and one.limit.channel], ids=lambda one: one.id)
def test_a_value_beyond_its_limit_is_shown_beyond_it(program: Program, fault: object) -> None:
    limit = fault.limit
    state = NO_ORDERS._replace(state=min(fault.live_in))
    most = getattr(program.limits, limit.in_program)
    channel = {"speed_rad_s": "drive_velocity_rad_s", "travel_rad": "angle_in_rad"}.get(limit.channel, limit.channel)
    value = 1.5 * most if isinstance(most, float) else int(1.5 * most) + 1
    row = next(one for one in seen(program, state, **{channel: value}).limits if one.fault == fault.id)
    assert row.watched
    assert row.share > 1.0
    if limit.beyond is Beyond.AGE:
        row = next(one for one in seen(program, state, **{channel: AGE_NEVER}).limits if one.fault == fault.id)
        assert row.actual == "not known"


def test_what_is_not_there_is_not_shown_as_a_value(program: Program) -> None:
    found = seen(program, sample_age_scans=AGE_NEVER, links_lost=Link.AMPLIFIER)
    amplifier = next(one for one in found.devices if one.title == "Measuring amplifier")
    assert amplifier.stale
    assert amplifier.lost
    assert {one.value for one in amplifier.readings} == {"never came"}
    assert found.torque_nm is None
    without = dataclasses.replace(program, has_torque_in=False)
    readings = [one for device in seen(without).devices for one in device.readings]
    assert next(one for one in readings if one.field == "torque_in_nm").value == "no sensor"


def test_alarms_stand_with_their_cause_first(program: Program) -> None:
    guard, warm = (next(one for one in FAULTS if one.id == name) for name in ("guard_open", "housing_temperature"))
    alarms = bit_of("guard_open") | bit_of("housing_temperature") | bit_of("drive_emergency")
    orders = NO_ORDERS._replace(state=State.FAULT, fault=warm.number, alarms=alarms)
    found = seen(program, orders, drive_emcy_code=0x8130).alarms
    assert [one.id for one in found] == ["housing_temperature", "guard_open", "drive_emergency"]
    assert [one.first for one in found] == [True, False, False]
    assert found[1].next_action == guard.next_action
    assert "0x8130" in found[2].detail


BEGUN = Standing(Fault("R1", "b", "fault", None, ""), recovery="R2")
WAYS = {
    "not begun": (Standing(BEGUN.fault), None, {}, [IN_HAND, *[TO_COME] * 5]),
    "guard open": (BEGUN, (State.FAULT, SETTLED), {"guard_closed": 0}, [DONE, IN_THE_WAY, IN_HAND, *[TO_COME] * 3]),
    "reacting": (BEGUN, (State.FAULT, 3), {}, [DONE, IN_HAND, *[TO_COME] * 4]),
    "asked": (BEGUN, (State.FAULT, SETTLED), {}, [DONE, IN_HAND, IN_HAND, *[TO_COME] * 3]),
    "resetting": (BEGUN, (State.FAULT, 5), {}, [*[DONE] * 3, *[TO_COME] * 3]),
    "unloading": (BEGUN, (State.UNLOAD, 1), {}, [*[DONE] * 3, IN_HAND, TO_COME, TO_COME]),
    "opening": (BEGUN, (State.RELEASE, 1), {}, [*[DONE] * 4, IN_HAND, TO_COME]),
    "open": (BEGUN, (State.STOPPED, 0), {}, [*[DONE] * 5, IN_HAND]),
    "over": (Standing(BEGUN.fault, released=True), None, {}, [*[DONE] * 5, IN_HAND]),
    "not released": (Standing(BEGUN.fault, said="no"), None, {}, [IN_HAND, *[TO_COME] * 5]),
}


@pytest.mark.parametrize("name", WAYS)
def test_the_way_back_is_told_step_by_step(program: Program, name: str) -> None:
    standing, at, image, expected = WAYS[name]
    sight = None if at is None else seen(program, NO_ORDERS._replace(state=at[0], phase=at[1]), **image)
    assert [row.standing for row in steps(standing, sight)] == expected


@pytest.mark.parametrize("name", WAYS)
def test_a_drive_that_nobody_has_measured_is_told_with_the_question(program: Program, name: str) -> None:
    standing, at, image, expected = WAYS[name]
    sight = None if at is None else seen(program, NO_ORDERS._replace(state=at[0], phase=at[1]), **image)
    unproven = dataclasses.replace(standing, fault=dataclasses.replace(standing.fault, unproven=True))
    question = steps(unproven, sight)[2]
    assert (question.seen == UNPROVEN_DRIVE) == (expected[2] != DONE)
    assert not steps(standing, sight)[2].seen


FACTS = RunFacts(
    recipe="r r1", bench="b r1", calibrations=("c1, due 2026-02-01",), software="1", computer="pc", virtual_unit="",
    closed=10, torque_in_zero_nm=0.01, torque_out_zero_nm=1.0, housing_c=22.0, room_c=21.0, p99_us=40.0, missed=0,
    oldest_sample_scans=2,
)  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"recipe": "r r2"}, "recipe"),
        ({"bench": "b r2"}, "bench file"),
        ({"calibrations": ()}, "calibrations"),
        ({"software": "2"}, "software"),
        ({"computer": "other"}, "computer"),
        ({"virtual_unit": "worn"}, "virtual unit"),
        ({"torque_in_zero_nm": 0.2}, "zero of the input torque"),
        ({"torque_out_zero_nm": -1.0}, "zero of the output torque"),
        ({"torque_out_zero_nm": None}, "zero of the output torque"),
        ({"housing_c": 41.0}, "housing temperature"),
        ({"room_c": 9.0}, "room temperature"),
        ({"p99_us": 400.0}, "wake-up latency, 99 %"),
        ({"missed": 3}, "missed periods"),
        ({"oldest_sample_scans": 9}, "oldest sample"),
    ],
)
def test_what_has_changed_stands_first_and_alone(changes: dict, what: str) -> None:
    found = changes_between(FACTS, dataclasses.replace(FACTS, closed=14, **changes))
    assert [row.what for row in found if row.changed] == [what]
    assert found[0].what == what
    assert "4 since" in next(row.now for row in found if row.what == "runs on this bench")


def test_runs_on_a_bench_are_counted_as_its_folders_are(tmp_path: Path) -> None:
    """Of runs of which fifteen begin in an hour; the 39th fails."""
    make_runs(tmp_path, 39)
    runs = sorted(path.name for path in tmp_path.glob("*-U*"))
    found = since_it_worked(tmp_path)
    assert (found.good, found.newest) == (runs[37], runs[38])
    shown = next(row for row in found.changes if row.what == "runs on this bench")
    assert (shown.before, shown.now) == ("38", "39, 1 since")
    make_runs(tmp_path, 1, first=39)
    found = since_it_worked(tmp_path)
    shown = next(row for row in found.changes if row.what == "runs on this bench")
    assert (found.good, shown.before, shown.now) == (runs[37], "38", "40, 2 since")


def test_a_run_that_has_not_ended_is_not_compared(tmp_path: Path) -> None:
    make_runs(tmp_path, 2)
    assert not since_it_worked(tmp_path).why_none
    Store(tmp_path).create("U9", SETUP, {})
    found = since_it_worked(tmp_path)
    assert (found.why_none, found.changes) == (IN_PROGRESS, ())


def test_a_run_without_a_result_has_no_timing_that_could_have_changed() -> None:
    found = changes_between(FACTS, dataclasses.replace(FACTS, p99_us=None, missed=None, oldest_sample_scans=None))
    assert [row.what for row in found if row.changed] == []


def test_a_calibration_is_due_on_its_day_and_a_bench_that_cannot_be_read_is_said(tmp_path: Path) -> None:
    curve = {"id": "blank-1", "made": "2026-01-01", "due": "2027-01-01", "angles": "both",
             "points": [{"torque": "-400 N·m", "deflection": "-0.04 arcmin"},
                        {"torque": "400 N·m", "deflection": "0.04 arcmin"}]}  # fmt: skip
    part = {"serial": "M-1", "expect": "PASS", "every": "8 h"}
    bench = write_changed(VIRTUAL_BENCH, tmp_path / "bench.yaml", {"fixture": {"curve": curve}, "master_parts": [part]})
    rows = (f"{{model: A, serial: 'A', recipe: '{GOLDEN}', bench: '{bench}'}}",
            f"{{model: B, serial: 'B', recipe: '{GOLDEN}', bench: '{tmp_path}/none.yaml'}}")  # fmt: skip
    (tmp_path / "models.yaml").write_text("models:\n" + "".join(f"  - {row}\n" for row in rows), encoding="utf-8")
    models = load_models(tmp_path, None)
    due = datetime(2027, 1, 1, 12, tzinfo=UTC)
    for days, (overdue, soon) in {-30: (False, False), -3: (False, True), 0: (False, True), 1: (True, False)}.items():
        found = due_on(tmp_path, models, due + timedelta(days=days))
        blank = next(row for row in found if "blank-1" in row.what)
        assert (blank.overdue, blank.soon) == (overdue, soon), days
        assert {row.what for row in found if row.overdue} >= {"model B", "master part M-1"}
