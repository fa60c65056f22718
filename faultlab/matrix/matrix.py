"""The fault matrix: every row of `fault_rows` in every state in which it can act, in virtual time, on all cores."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache

from definitions.faults import FAULT_BY_ID
from definitions.image import Reaction
from faultlab.judge import first_action, first_alarm, low_from, not_as_in_table
from faultlab.rows import AFTER_SCANS, ROWS, STATES, Row
from faultlab.run import Bench, FaultRun
from station.bench.assemble_virtual import choose_unit, virtual_config
from station.bench.request import Job, load_job
from station.bench.virtual_unit import FIXED_SEED
from virtual_bench.faults.reactions import REACTIONS
from virtual_bench.faults.scenario import Fault, Header, Scenario, When

RECIPE = "rv-40e-121-faults"
LOW_SHARE_OF_RATED = 0.02
LEAD_SCANS = 200
TRACE_POINTS = 120
TRACE_BEFORE, TRACE_AFTER = 200, 1000


@dataclass(frozen=True)
class Cell:
    """One fault in one state: what came of it. Times in scans, torque time in s; None where there is nothing to say."""

    row: int
    state: str
    alarm: str = ""
    reaction: str = ""
    final_state: str = ""
    detect_scans: int | None = None
    order_scans: int | None = None
    torque_s: float | None = None
    rest_nm: float = 0.0
    peak_nm: float = 0.0
    wrong: tuple[str, ...] = ()
    trace_nm: tuple[float, ...] = ()


@cache
def job() -> Job:
    """Return the matrix's recipe on the shipped bench."""
    return load_job(RECIPE, None)


def scenario_of(row: Row | None, state: str) -> Scenario:
    """Return the scenario of a cell, or one without faults."""
    if row is None:
        return Scenario(scenario=Header(name="undisturbed"), faults=())
    when = When(state=state, after_scans=AFTER_SCANS[state])
    fault = Fault(target=row.target, verb=row.verb, value=row.value, when=when, for_ms=row.for_ms)
    return Scenario(scenario=Header(name=f"{row.name} in {state}"), faults=(fault,))


def bench_of(scenario: Scenario | None) -> Bench:
    """Return a bench before its first scan, with the matrix's recipe and unit."""
    work = job()
    unit = choose_unit(None, work.recipe, FIXED_SEED)
    return Bench(work.program, virtual_config(work.bench, work.profile_paths, unit), scenario)


@cache
def undisturbed() -> dict[str, Bench]:
    """Benches of one undisturbed run, each stopped just before the moment at which faults start in its state."""
    bench = bench_of(None)
    found: dict[str, Bench] = {}
    for state in STATES:
        while bench.state != state:
            bench.go()
        lead = max(AFTER_SCANS[state] - LEAD_SCANS, 0)
        for _ in range(lead):
            bench.go()
        found[state] = bench.branch(scenario_of(None, state))
    return found


def measure(number: int, state: str) -> Cell:
    """Run one cell, from the undisturbed run's state on."""
    row = ROWS[number]
    run = undisturbed()[state].branch(scenario_of(row, state)).finish()
    return assess(run, number, row, state, job().recipe.unit_under_test.rated_torque_nm)


def assess(run: FaultRun, number: int, row: Row, state: str, rated_nm: float, *, wire_scans: int = 0) -> Cell:
    """Compare a run with its row's bounds, longer by `wire_scans` over wires."""
    acted, alarm = first_action(run), first_alarm(run)
    wrong = list(run.unseen)
    final, rest_nm = run.states[-1], abs(run.torque_nm[-1])
    peak_nm = max(map(abs, run.torque_nm[acted or 0 :]))
    if not row.causes or alarm is None or acted is None:
        if bool(row.causes) != (alarm is not None):
            wrong.append("no alarm" if row.causes else f"alarm {run.alarms()[0].text}")
        if not row.causes and final != "complete":
            wrong.append(f"ended in {final}")
        trace = _trace(run, acted or 0)
        return Cell(number, state, "", "", final, None, None, None, rest_nm, peak_nm, tuple(wrong), trace)
    # a milder alarm may come first: late samples before stale ones
    event = next((event for event in run.alarms() if event.text in row.causes), run.alarms()[0])
    alarm, cause = run.place(event.scan), FAULT_BY_ID[event.text]
    detect = run.waited(acted, alarm)
    order = _answered(run, alarm, cause.reaction)
    limit_nm = LOW_SHARE_OF_RATED * rated_nm
    low = low_from(run, alarm, limit_nm)
    torque_s = None if low is None or cause.reaction <= Reaction.HOLD else low * run.period_s
    if cause.id not in row.causes:
        wrong.append(f"alarm {cause.id}, expected {' or '.join(row.causes)}")
    if detect > row.detect_scans + wire_scans:
        wrong.append(f"detected after {detect} scans, allowed {row.detect_scans + wire_scans}")
    if order != 0:
        wrong.append(f"the reaction was ordered {order} scans after the alarm")
    else:
        wrong += not_as_in_table(run, _came_into_force(run, alarm))
    if cause.reaction > Reaction.HOLD:
        wrong += _wrong_end(row, final, torque_s, rest_nm, rated_nm)
    return Cell(
        number, state, cause.id, cause.reaction.name.lower(), final, detect, order, torque_s, rest_nm, peak_nm,
        tuple(wrong), _trace(run, alarm),
    )  # fmt: skip


def _answered(run: FaultRun, alarm: int, reaction: Reaction) -> int | None:
    """Scans from an alarm until its reaction, or a stronger one, is in force with its order; None when it never is.

    An earlier alarm may have brought the reaction about: then the order that follows may be given already.
    """
    before = run.orders[alarm - 1].reaction if alarm else Reaction.NONE
    for place in range(alarm, len(run.orders)):
        given = run.orders[place]
        row = REACTIONS.get(Reaction(given.reaction))
        if row is None or given.reaction < reaction:
            continue
        following = row.then if before == given.reaction else None
        if given.drive_command in row.orders or (following is not None and given.drive_command == following):
            return run.waited(alarm, place)
    return None


def _came_into_force(run: FaultRun, place: int) -> int:
    """Place at which the reaction that is in force at a place came into force."""
    while place and run.orders[place - 1].reaction == run.orders[place].reaction:
        place -= 1
    return place


def _wrong_end(row: Row, final: str, torque_s: float | None, rest_nm: float, rated_nm: float) -> list[str]:
    """Say what is wrong with how a reaction ended."""
    wrong = [] if final == "fault" else [f"ended in {final}"]
    if torque_s is not None and torque_s > row.torque_s:
        wrong.append(f"torque low after {torque_s:.2f} s, allowed {row.torque_s:g} s")
    if torque_s is None and rest_nm > row.rest * rated_nm:
        wrong.append(f"{rest_nm:.1f} N·m residual torque in the unit, allowed {row.rest * rated_nm:.1f} N·m")
    return wrong


def _trace(run: FaultRun, place: int) -> tuple[float, ...]:
    """Torque in the reducer around a place, thinned to a small picture."""
    piece = run.torque_nm[max(place - TRACE_BEFORE, 0) : place + TRACE_AFTER]
    step = max(len(piece) // TRACE_POINTS, 1)
    return tuple(round(value, 2) for value in piece[::step])


def cells(names: Iterable[str] = ()) -> list[tuple[int, str]]:
    """Return row number and state of every cell; of the rows whose name holds one of `names` when there are any."""
    wanted = tuple(names)
    return [
        (number, state)
        for number, row in enumerate(ROWS)
        if not wanted or any(name in row.name for name in wanted)
        for state in row.states
    ]


def run_matrix(chosen: list[tuple[int, str]], workers: int, progress: Callable[[Cell], None]) -> list[Cell]:
    """Run cells on several cores; `progress` is called with each as it comes, in order."""
    found = []
    with ProcessPoolExecutor(workers) as pool:
        for cell in pool.map(measure, *zip(*chosen, strict=True), chunksize=2):
            progress(cell)
            found.append(cell)
    return found
