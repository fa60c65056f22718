"""A torque that lags reads a wide loop as a narrow one; whatever the trace leaves out, that is no PASS."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from analysis.evaluation.pipeline import Result, analyse
from analysis.evaluation.verdict import Verdict
from analysis.loop.method import Decision, MetricWanted
from analysis.trace.trace import SegmentInfo, Trace
from analysis.validity.ramp_ends import ramp_ends
from benchmarks.simulated.kinds import KINDS, Kind
from benchmarks.simulated.loop_generator import (
    SOUND,
    Bench,
    Defect,
    course_of,
    figures_of,
    measured,
    method_of,
    without_dwells,
    without_segments,
)
from benchmarks.simulated.truth import truth, with_backlash

RV40 = KINDS["RV-40E"]
BENCH = Bench()
AT_ONCE = replace(BENCH, dwell_s=0.0)
BACKLASH = MetricWanted("backlash_width_3pct", max=1.0)

Change = Callable[[Trace], Trace]


def as_is(trace: Trace) -> Trace:
    return trace


@cache
def seen(unit: Kind, bench: Bench, defect: Defect) -> Trace:
    return measured(unit, course_of(unit, bench), bench, np.random.default_rng(1), defect)


def judged(
    unit: Kind, bench: Bench, defect: Defect = SOUND, change: Change = as_is, wanted: MetricWanted = BACKLASH
) -> Result:
    method = method_of(unit, bench)
    return analyse(
        change(seen(unit, bench, defect)), method, [wanted], Decision("guard_band"), figures=figures_of(unit)
    )


def failed(result: Result) -> set[str]:
    return {check.id for check in result.checks if check.passed is False}


def in_two_pieces(trace: Trace) -> Trace:
    """Each ramp commanded in two pieces, without dwells: no turn and no end of a ramp tells a delay."""
    trace = without_dwells(trace)
    segment, table = 2 * trace.segment, {}
    for key, info in trace.segments.items():
        rows = np.flatnonzero(trace.segment == key)
        segment[rows[rows.size // 2 :]] += 1
        table |= {2 * key: info, 2 * key + 1: SegmentInfo(*info)}
    return replace(trace, segment=segment, segments=table)


DISGUISES = {
    "no segment column": (BENCH, without_segments),
    "no dwell": (AT_ONCE, as_is),
    "no dwell, no segment column": (AT_ONCE, without_segments),
    "rows of the dwells cut": (BENCH, without_dwells),
    "rows of the dwells cut, time renumbered": (BENCH, lambda trace: without_dwells(trace, renumbered=True)),
    "rows of the dwells cut, no segment column": (BENCH, lambda trace: without_segments(without_dwells(trace))),
    "dwell of 40 ms": (replace(BENCH, dwell_s=0.04), as_is),
    "dwell of 60 ms, no segment column": (replace(BENCH, dwell_s=0.06), without_segments),
    "100 samples/s": (replace(AT_ONCE, period_s=0.01), as_is),
}


@pytest.mark.parametrize("lag_s", [0.15, 0.3])
@pytest.mark.parametrize("disguise", DISGUISES)
def test_torques_that_lag_are_seen_at_the_turns(disguise: str, lag_s: float) -> None:
    """A backlash of 1.14 arcmin read 0.93 with 150 ms and 0.67 with 300 ms, and passed a limit of 1."""
    bench, change = DISGUISES[disguise]
    bad = with_backlash(RV40, 1.14, bench.peak * RV40.rated_nm)
    result = judged(bad, bench, Defect(lag_s=lag_s), change)
    assert result.metrics[0].headline.value < 0.95
    assert "late_torque" in failed(result)
    assert result.reasons[0].startswith("measurement invalid: late_torque")  # a shaft that stands under it is no cause
    assert result.verdict is Verdict.NOT_DECIDABLE


@pytest.mark.parametrize("delay_s", [-0.3, -0.8, -1.0])
def test_an_angle_that_is_late_makes_no_lost_motion_pass(delay_s: float) -> None:
    """0.42 arcmin read 0.24 to 0.27 and passed a limit of 0.37: its turns scattered, taken for no delay."""
    wanted = MetricWanted("lost_motion", max=truth(RV40, "lost_motion", 1, BENCH.peak * RV40.rated_nm) / 1.15)
    result = judged(RV40, BENCH, Defect(delay_s=delay_s), without_segments, wanted)
    assert result.metrics[0].headline.value < wanted.max
    assert result.verdict is Verdict.NOT_DECIDABLE


@pytest.mark.parametrize("bench", [BENCH, AT_ONCE])
@pytest.mark.parametrize("defect", [Defect(lag_s=0.0145), Defect(delay_s=0.0145), Defect(lag_s=0.01)])
def test_a_delay_within_its_limit_is_a_row_of_the_budget(defect: Defect, bench: Bench) -> None:
    """1.015 arcmin read 0.991 ± 0.006: the check let the delay pass, and nothing else knew of it."""
    near = with_backlash(RV40, 1.015, bench.peak * RV40.rated_nm)
    result = judged(near, bench, defect)
    side = result.metrics[0].headline
    assert not failed(result)
    assert result.verdict is not Verdict.PASS
    assert "late" in [row["quantity"] for row in side.budget_rows]
    exact = truth(near, "backlash_width_3pct", 1, bench.peak * RV40.rated_nm)
    assert abs(side.value - exact) < side.uncertainty


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("disguise", ["no segment column", "no dwell", "rows of the dwells cut", "dwell of 40 ms"])
def test_no_delay_is_told_of_a_sound_measurement(kind: str, disguise: str) -> None:
    bench, change = DISGUISES[disguise]
    result = judged(KINDS[kind], bench, change=change, wanted=MetricWanted("backlash_width_3pct", max=4.0))
    (late,) = [check for check in result.checks if check.id == "late_torque"]
    assert late.passed
    assert result.verdict is Verdict.PASS, result.reasons


def test_where_nothing_tells_the_delay_a_width_is_not_decided() -> None:
    """A stiffness is: a delay moves the loading branch along, and does not tilt it."""
    result = judged(RV40, BENCH, change=in_two_pieces)
    assert result.verdict is Verdict.NOT_DECIDABLE
    assert result.reasons[0].startswith("backlash_width_3pct")
    assert next(check for check in result.checks if check.id == "late_torque").passed is None
    stiff = MetricWanted("stiffness_50_100", branch="load", min=100.0)
    assert judged(RV40, BENCH, change=in_two_pieces, wanted=stiff).verdict is Verdict.PASS


def rounded_end(phase: float, delay_s: float) -> tuple[Trace, np.ndarray]:
    """A ramp of 120 N·m/s that slows down over its last 150 ms and creeps at rest; its encoder waves.

    As the quick recipe has it on the virtual bench.
    """
    t_s = np.arange(2500) * 1e-3
    speed = np.interp(t_s, [1.86, 1.92, 1.98, 2.03], [1.1, 0.7, 0.35, 0.0])
    shift = np.cumsum(speed) * 1e-3
    windup = shift + 0.08 * np.cumsum(1.0 - speed / 1.1) * 1e-3
    torque = np.interp(t_s - delay_s, t_s, 220.0 + 110.0 * shift)
    torque += np.random.default_rng(1).normal(scale=0.2, size=t_s.size)
    seen = windup + 0.0025 * np.sin(2.0 * np.pi * (windup / 0.018 + phase))
    segments = {0: SegmentInfo("measure", 1, 1), 1: SegmentInfo("dwell", 0, 1)}
    trace = Trace(t_s=t_s, torque_out_nm=torque, segment=(t_s >= 2.0).astype(np.int64), segments=segments)
    return trace, seen


@pytest.mark.parametrize("delay_s", [0.0, 0.005, -0.005])
def test_the_wave_of_an_encoder_is_no_delay_at_the_rounded_end_of_a_fast_ramp(delay_s: float) -> None:
    """Where all that was seen bent evenly, creep stood for a delay: a wave of 0.0025 arcmin made 13 ms of it."""
    ends = [one for phase in np.arange(8) / 8.0 for one in ramp_ends(*rounded_end(float(phase), delay_s))]
    wrong_s = np.array([one.late_s for one in ends]) - delay_s
    assert wrong_s.size == 8
    assert np.abs(wrong_s).max() < 0.008
    assert abs(wrong_s.mean()) < 0.002
