"""What `lostmotion faults run` says of a scenario: whether it holds, each breach with its line, and what was given."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from faultlab.given import begin, given, orders, reactions, visits
from faultlab.judge import Breach, first_action, first_alarm, low_from
from faultlab.matrix.matrix import LOW_SHARE_OF_RATED
from faultlab.run import FaultRun
from recipes.text.problems import Source
from station.bench.virtual_unit import VirtualUnit
from virtual_bench.faults.scenario import Scenario


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
        figures = _figures(scenario, source, found, wrong, rated_nm=rated_nm, unit=unit, record=record)
        sys.stdout.write(json.dumps(figures, ensure_ascii=False) + "\n")
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


def _figures(
    scenario: Scenario,
    source: Source,
    found: FaultRun,
    wrong: list[Breach],
    *,
    rated_nm: float,
    unit: VirtualUnit | None,
    record: Path | None,
) -> dict[str, Any]:
    low_s = _low_s(found, rated_nm)
    in_force = [{"reaction": change.name, "scan": found.scans[change.place]} for change in reactions(found)]
    ordered = [{"order": change.name, "scan": found.scans[change.place]} for change in orders(found, begin(found))]
    return {
        "scenario": scenario.scenario.name,
        "holds": not wrong,
        "wrong": [breach.text for breach in wrong],
        "lines": [source.nearest_mark(breach.option).line if breach.option else None for breach in wrong],
        "unit": None if unit is None else {"virtual": unit.name, "noise_seed": unit.seed},
        "states": found.states,
        "visits": [{"state": visit.state, "scan": visit.entered} for visit in visits(found)],
        "acted": [{"fault": name, "scan": found.scans[place]} for name, place in found.acted],
        "alarms": [{"id": event.text, "scan": event.scan, "state": event.state} for event in found.alarms()],
        "reactions": in_force,
        "orders": ordered,
        "detect_scans": _detected(found),
        "torque_low_s": None if low_s is None else round(low_s, 6),
        "refused": found.refused,
        "record": None if record is None else str(record),
    }


def _detected(found: FaultRun) -> int | None:
    """Scans from the first fault to the first alarm; None where something else than the fault came first."""
    acted, alarm = first_action(found), first_alarm(found)
    return None if acted is None or alarm is None or alarm < acted else found.waited(acted, alarm)


def _low_s(found: FaultRun, rated_nm: float) -> float | None:
    """Seconds from the first alarm until the torque stays low; None when it never does."""
    alarm = first_alarm(found)
    low = None if alarm is None else low_from(found, alarm, LOW_SHARE_OF_RATED * rated_nm)
    return None if low is None else low * found.period_s
