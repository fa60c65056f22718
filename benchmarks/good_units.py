"""`python -m benchmarks.good_units [--units N] [--page P]`: whether a good unit is ever refused, and for what.

Units of the six types of `kinds`, each within its limits by a quarter, measured by benches whose noise is
between half and twice what they declare, with and without segments, rests at the turns, and input torque. Counted is
every verdict that is not PASS, by the reason that stands first.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from analysis.evaluation.pipeline import Result, analyse
from analysis.evaluation.verdict import Verdict
from analysis.loop.method import Decision, MetricWanted
from analysis.trace.trace import Trace
from benchmarks.page import put
from benchmarks.simulated.kinds import KINDS, Kind
from benchmarks.simulated.loop_generator import (
    Bench,
    course_of,
    figures_of,
    measured,
    method_of,
    without_dwells,
    without_segments,
)
from benchmarks.simulated.truth import truth

SEED = 50
ROOM = 0.25
"""Share by which a unit is better than its limits: no uncertainty of a bench in order comes near."""

NOISE = (0.5, 2.0)
"""Noise of the torques, of what the bench declares."""

PASSED = "PASS"


class Case(NamedTuple):
    """What a trace has: names of the segments, rests at the turns, a calibration before the cycles, input torque."""

    segments: bool
    dwells: bool
    calibration: bool
    torque_in: bool

    def __str__(self) -> str:
        parts = zip(("segments", "rests", "calibration", "input torque"), self, strict=True)
        return ", ".join(name for name, there in parts if there) or "torque and angles alone"


def limits_of(unit: Kind, peak_nm: float) -> list[MetricWanted]:
    """Return limits that the unit keeps by `ROOM`, on both sides."""

    def of(name: str) -> list[float]:
        return [truth(unit, name, side, peak_nm) for side in (1, -1)]

    return [
        MetricWanted("backlash_width_3pct", max=(1.0 + ROOM) * max(of("backlash_width_3pct"))),
        MetricWanted("hysteresis_energy", max=(1.0 + ROOM) * max(of("hysteresis_energy"))),
        MetricWanted("stiffness_50_100", min=(1.0 - ROOM) * min(of("stiffness_50_100 load"))),
        MetricWanted("stiffness_lsq", min=(1.0 - ROOM) * min(of("stiffness_lsq"))),
    ]


def as_recorded(trace: Trace, case: Case) -> Trace:
    """Return a trace with what the case leaves of it."""
    if not case.torque_in:
        trace = replace(trace, torque_in_nm=None)
    if not case.dwells:
        trace = without_dwells(trace)
    return trace if case.segments else without_segments(trace)


def reason_of(result: Result) -> str:
    """Return why a result is not PASS: the checks that failed, or what its first metric says."""
    if result.verdict is Verdict.PASS:
        return PASSED
    failed = [check.id for check in result.checks if check.passed is False]
    return ", ".join(failed) or result.reasons[0]


def study(units: int) -> dict[Case, Counter[str]]:
    """Measure so many good units, type by type, each as another case; return the reasons by case."""
    cases = [Case(*(bool(number >> bit & 1) for bit in range(4))) for number in range(16)]
    found: dict[Case, Counter[str]] = {case: Counter() for case in reversed(cases)}
    for number in range(units):
        random = np.random.default_rng([SEED, number])
        case = cases[number // len(KINDS) % len(cases)]
        unit = list(KINDS.values())[number % len(KINDS)].varied(random)
        noise = float(np.exp(random.uniform(*np.log(NOISE))))
        bench = Bench(dwell_s=0.5 if case.dwells else 0.0, calibrate=case.calibration, noise=noise)
        trace = as_recorded(measured(unit, course_of(unit, bench), bench, random), case)
        wanted = limits_of(unit, bench.peak * unit.rated_nm)
        result = analyse(trace, method_of(unit, bench), wanted, Decision("guard_band", 0.82), figures=figures_of(unit))
        found[case][reason_of(result)] += 1
    return found


def table(found: dict[Case, Counter[str]]) -> str:
    """Return the study as Markdown."""
    rows = ["| what the trace has | units | PASS | refused, by reason |", "| --- | --- | --- | --- |"]
    for case, reasons in found.items():
        refused = "; ".join(f"{count} × {why}" for why, count in sorted(reasons.items()) if why != PASSED)
        rows.append(f"| {case} | {sum(reasons.values())} | {reasons[PASSED]} | {refused or 'none'} |")
    units = sum(sum(reasons.values()) for reasons in found.values())
    passed = sum(reasons[PASSED] for reasons in found.values())
    return "\n".join([*rows, "", f"{units} good units of six types: {passed} PASS."])


def main() -> int:
    """Run the study, print its table, and put it into a page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.good_units", description=__doc__)
    parser.add_argument("--units", type=int, default=500, help="units measured (default 500)")
    parser.add_argument("--page", type=Path, help="put the table into this page")
    asked = parser.parse_args()
    text = table(study(asked.units))
    sys.stdout.write(f"{text}\n")
    if asked.page is not None:
        put(asked.page, "good units", text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
