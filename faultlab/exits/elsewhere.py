"""Exits that belong to other states than a ramp: provoked where what they wait for, or look at, can go wrong."""

from __future__ import annotations

from dataclasses import replace

from controller.controller import Controller
from definitions.faults import FAULT_BY_ID, Limit
from definitions.image import Image, State
from faultlab.exits.judge import Measured, judge_exit
from faultlab.exits.rows import Exit
from faultlab.exits.shown import Shown
from faultlab.judge import first_alarm
from faultlab.matrix.matrix import bench_of, scenario_of, undisturbed
from faultlab.rows import REST_SHARE_OF_RATED, ROWS, STATES, Row
from faultlab.run import FaultRun
from virtual_bench.faults.scenario import Fault as Injected
from virtual_bench.faults.scenario import Header, Scenario, When

SMALL_CALIBRATION = 0.3
"""Share of the recipe's calibration torque: low enough that the two torque channels still pass for agreeing."""


def from_alarm(row: Exit, run: FaultRun, by: str) -> Measured | None:
    """Judge a run from its first alarm on; None when the fault of the row is not among the alarms."""
    begin = first_alarm(run)
    if begin is None or row.id not in {event.text for event in run.alarms()}:
        return None
    return judge_exit(row, run, begin, by, began=run.alarms()[0].state, ended=run.states[-1])


def provokers(fault: str, state: str) -> list[Row]:
    """Rows of the fault matrix that may raise a fault when they start in a state.

    Not those after which no drive can take the torque away: a unit that jams keeps it, and the matrix says how much.
    """
    rows = [row for row in ROWS if fault in row.causes and state in row.states]
    return [row for row in rows if row.rest <= REST_SHARE_OF_RATED]


def worst_in(row: Exit, state: str) -> Measured | None:
    """Provoke a fault by every row of the matrix that may raise it from a state; the slowest, None when none does.

    Time counts from the first alarm of the run, and another may come first: an emergency stop takes the drive's power.
    """
    worst: Measured | None = None
    for provoker in provokers(row.id, state):
        run = undisturbed()[state].branch(scenario_of(provoker, state)).finish()
        found = from_alarm(row, run, provoker.name)
        if found is not None and (
            worst is None or (found.down_s or row.bound_s, found.peak_nm) > (worst.down_s or 0.0, worst.peak_nm)
        ):
            worst = found
    return worst


def measure_fault(row: Exit) -> Measured | None:
    """Provoke a fault in a ramp, or else in the first state from which a row of the matrix raises it.

    One that no row raises is provoked by its channel, where it has one.
    """
    for state in ("ramp_pos", *(state for state in STATES if state != "ramp_pos")):
        if (found := worst_in(row, state)) is not None:
            return found
    return beyond_limit(row)


def limit_in_image(fault: str) -> Limit | None:
    """Return the limit of an interlock whose channel can be shown to the controller beyond it; None for any other."""
    limit = FAULT_BY_ID[fault].limit
    return limit if limit is not None and limit.channel in Image._fields else None


def beyond_limit(row: Exit) -> Measured | None:
    """Show the channel of an interlock beyond its limit, in the ramp, or else in the first state that looks at it."""
    limit = limit_in_image(row.id)
    if limit is None:
        return None
    live = [state for state in ("ramp_pos", *STATES) if State[state.upper()] in FAULT_BY_ID[row.id].live_in]
    limits = undisturbed()[live[0]].controller.program.limits
    shown = {limit.channel: 2 * getattr(limits, limit.in_program) + 1}
    return _shown_in(row, live[0], f"{limit.channel} shown beyond its limit", shown)


def _shown_in(row: Exit, state: str, by: str, shown: dict[str, float]) -> Measured | None:
    bench = undisturbed()[state].branch(scenario_of(None, state))
    bench.bench = Shown(bench.bench, shown)  # type: ignore[assignment]
    return from_alarm(row, bench.finish(), by)


def homing_failed(row: Exit) -> Measured | None:
    """The drive says that it has not found its reference."""
    return _shown_in(row, "home", "status word bit 13 in homing mode", {"drive_homing_error": 1})


def brake_stays_closed(row: Exit) -> Measured | None:
    """The brake supply is still on after it was ordered off."""
    return _shown_in(row, "release", "output of the brake supply stays on", {"brake_on": 1, "brake_current_a": 6.0})


def devices_not_ready(row: Exit) -> Measured | None:
    """The measuring amplifier is silent from the beginning."""
    silent = Injected(target="modbus.amplifier", verb="silence", when=When(time_s=0.0))
    run = bench_of(Scenario(scenario=Header(name=row.id), faults=(silent,))).finish()
    return from_alarm(row, run, "modbus.amplifier silence")


def calibration_failed(row: Exit) -> Measured | None:
    """The input torque stands still in a calibration that is too small for the torque channels to be compared."""
    bench = bench_of(None)
    program = bench.controller.program
    segments = tuple(
        replace(one, start_nm=SMALL_CALIBRATION * one.start_nm, target_nm=SMALL_CALIBRATION * one.target_nm)
        if one.state == State.CALIBRATE
        else one
        for one in program.segments
    )
    control = replace(program.control, measure_ratio=True)
    bench.controller = Controller(replace(program, segments=segments, control=control))
    bench.until(lambda orders: orders.state == State.CALIBRATE)
    now = When(scan=bench.run.scans[-1])
    bench.faults.inject((Injected(target="sensor.torque_in", verb="stuck", when=now),))
    return from_alarm(row, bench.finish(), "sensor.torque_in stuck in a small calibration")
