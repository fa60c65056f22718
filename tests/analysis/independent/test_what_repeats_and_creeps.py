"""Creep against the torque, copies with dither: what makes a bad unit pass, and leaves U as it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.evaluation.pipeline import Result, analyse
from analysis.evaluation.verdict import Verdict
from analysis.loop.method import Decision, MetricWanted
from analysis.trace.trace import Trace
from benchmarks.simulated.loop_generator import (
    KINDS,
    Bench,
    Defect,
    course_of,
    figures_of,
    measured,
    method_of,
    with_backlash,
)

RV40 = KINDS["RV-40E"]
BACKLASH = [MetricWanted("backlash_width_3pct", max=1.0)]


def judged(trace: Trace, bench: Bench) -> Result:
    return analyse(trace, method_of(RV40, bench), BACKLASH, Decision("guard_band"), figures=figures_of(RV40))


def failed(result: Result) -> set[str]:
    return {check.id for check in result.checks if check.passed is False}


@pytest.mark.parametrize(("dwell_s", "rates"), [(0.5, (0.3, 1.0, 1.6)), (0.0, (0.7, 1.2, 2.5))])
def test_creep_against_the_torque_is_seen_in_dwells_or_in_the_width(dwell_s: float, rates: tuple[float, ...]) -> None:
    """At 1.2 arcmin/min a backlash of 1.14 read 0.85 and passed; no unit creeps back against its load."""
    bench = Bench(dwell_s=dwell_s, cycles=2)
    course = course_of(with_backlash(RV40, 1.14, 1.1 * RV40.rated_nm), bench)
    for rate in rates:
        trace = measured(RV40, course, bench, np.random.default_rng(1), Defect(creep_arcmin_per_min=-rate))
        result = judged(trace, bench)
        assert ("creep_back" if dwell_s else "width_growth") in failed(result)
        assert result.verdict is Verdict.NOT_DECIDABLE


@pytest.mark.parametrize("dither_nm", [0.0, 0.01, 0.1])
def test_a_cycle_that_is_a_copy_with_dither_is_no_measurement(dither_nm: float) -> None:
    bench = Bench(cycles=2, calibrate=False)
    trace = measured(RV40, course_of(RV40, bench), bench, np.random.default_rng(1))
    segments = [key for key, info in trace.segments.items() if info.role == "measure"]
    changed = {}
    for name in ("torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad"):
        values = getattr(trace, name).copy()
        for first, second in zip(segments[:2], segments[2:], strict=True):
            rows = np.flatnonzero(trace.segment == second)
            values[rows] = values[np.flatnonzero(trace.segment == first)]
            scale = RV40.ratio if name == "torque_in_nm" else 1.0
            if name.startswith("torque"):
                values[rows] += np.random.default_rng(2).normal(0.0, dither_nm / scale, rows.size)
        changed[name] = values
    assert "copied_cycles" in failed(judged(replace(trace, **changed), bench))
    assert "copied_cycles" not in failed(judged(trace, bench))
