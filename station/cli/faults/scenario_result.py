"""What `lostmotion faults run` says of a scenario: whether it holds, each breach with its line, and what was given."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from faultlab.given import begin, given, orders, reactions, visits
from faultlab.judge import Breach, first_action, first_alarm, low_from
from faultlab.matrix.matrix import LOW_SHARE_OF_RATED
from faultlab.run import FaultRun
from recipes.text.problems import Source
from station.bench.virtual_unit import VirtualUnit
from station.documents.entries import plain
from virtual_bench.faults.scenario import Scenario


class UnitSaid(NamedTuple):
    """The virtual unit that was on the bench, and the seed of its noise."""

    virtual: str
    noise_seed: int


class Visit(NamedTuple):
    """A state, and the scan in which it was entered."""

    state: str
    scan: int


class Acted(NamedTuple):
    """A fault, and the scan in which it acted."""

    fault: str
    scan: int


class AlarmSaid(NamedTuple):
    """An alarm with its scan and state."""

    id: str
    scan: int
    state: str


class InForce(NamedTuple):
    """A reaction, and the scan from which it was in force."""

    reaction: str
    scan: int


class Ordered(NamedTuple):
    """An order, and the scan in which it was given."""

    order: str
    scan: int


@dataclass(frozen=True)
class ScenarioResult:
    """What `faults run --json` says: whether the scenario holds, each breach with its line, and what was given."""

    scenario: str
    holds: bool
    wrong: list[str]
    lines: list[int | None]
    unit: UnitSaid | None
    states: list[str]
    visits: list[Visit]
    acted: list[Acted]
    alarms: list[AlarmSaid]
    reactions: list[InForce]
    orders: list[Ordered]
    detect_scans: int | None
    torque_low_s: float | None
    refused: str
    record: str | None


def say_result(
    scenario: Scenario,
    source: Source,
    found: FaultRun,
    wrong: list[Breach],
    *,
    rated_nm: float,
    unit: VirtualUnit | None,
    record: Path | None,
    as_json: bool,
) -> None:
    """Print the result of a scenario; `source` is its file, for the lines of what does not hold."""
    if as_json:
        said = _result(scenario, source, found, wrong, rated_nm=rated_nm, unit=unit, record=record)
        sys.stdout.write(json.dumps(plain(said), ensure_ascii=False) + "\n")
        return
    lines = [f"{scenario.scenario.name}: {'holds' if not wrong else 'DOES NOT HOLD'}"]
    lines += [f"  {_place(source, breach)}{breach.text}" for breach in wrong]
    lines += [f"  {kind:9} {text}" for kind, text in given(found).items()]
    detected, low_s = _detected(found), _low_s(found, rated_nm)
    if detected is not None:
        lines.append(f"  detected  after {detected} scans")
    if low_s is not None:
        lines.append(f"  torque    below 2 % of rated {low_s:.3f} s after the alarm")
    if found.refused:
        lines.append(f"  refused   {found.refused}")
    if unit is not None:
        lines.append(f"  unit      {unit.name}, noise seed {unit.seed}")
    if record is not None:
        lines.append(f"  record    {record}")
    sys.stdout.write("\n".join(lines) + "\n")


def _place(source: Source, breach: Breach) -> str:
    """Return file, line and column of the entry that a breach is of; nothing for what is of no entry."""
    if not breach.option:
        return ""
    mark = source.nearest_mark(breach.option)
    return f"{source.path}:{mark.line}:{mark.column}: "


def _result(
    scenario: Scenario,
    source: Source,
    found: FaultRun,
    wrong: list[Breach],
    *,
    rated_nm: float,
    unit: VirtualUnit | None,
    record: Path | None,
) -> ScenarioResult:
    low_s = _low_s(found, rated_nm)
    return ScenarioResult(
        scenario=scenario.scenario.name,
        holds=not wrong,
        wrong=[breach.text for breach in wrong],
        lines=[source.nearest_mark(breach.option).line if breach.option else None for breach in wrong],
        unit=None if unit is None else UnitSaid(unit.name, unit.seed),
        states=found.states,
        visits=[Visit(visit.state, visit.entered) for visit in visits(found)],
        acted=[Acted(name, found.scans[place]) for name, place in found.acted],
        alarms=[AlarmSaid(event.text, event.scan, event.state) for event in found.alarms()],
        reactions=[InForce(change.name, found.scans[change.place]) for change in reactions(found)],
        orders=[Ordered(change.name, found.scans[change.place]) for change in orders(found, begin(found))],
        detect_scans=_detected(found),
        torque_low_s=None if low_s is None else round(low_s, 6),
        refused=found.refused,
        record=None if record is None else str(record),
    )


def _detected(found: FaultRun) -> int | None:
    """Scans from the first fault to the first alarm; None where something else than the fault came first."""
    acted, alarm = first_action(found), first_alarm(found)
    return None if acted is None or alarm is None or alarm < acted else found.waited(acted, alarm)


def _low_s(found: FaultRun, rated_nm: float) -> float | None:
    """Seconds from the first alarm until the torque stays low; None when it never does."""
    alarm = first_alarm(found)
    low = None if alarm is None else low_from(found, alarm, LOW_SHARE_OF_RATED * rated_nm)
    return None if low is None else low * found.period_s
