"""Creep against the torque, copies with dither, waves of an encoder: what passes a bad unit and leaves U as it was."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from analysis.evaluation.pipeline import Result, analyse
from analysis.evaluation.verdict import Verdict
from analysis.loop.method import Decision, MetricWanted
from analysis.trace.trace import Trace
from benchmarks.simulated.kinds import KINDS
from benchmarks.simulated.loop_generator import ARCMIN_RAD, Bench, Defect, course_of, figures_of, measured, method_of
from benchmarks.simulated.truth import with_backlash

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


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("kept", "seen"), [(0, True), (-1, False)])
def test_dwells_without_time_between_their_samples_show_no_creep(kept: int, seen: bool) -> None:  # noqa: FBT001 - a row of a table
    """Where time is rounded, all samples behind the first have one time, or there is one sample behind it alone."""
    bench = Bench(dwell_s=0.5, cycles=2)
    trace = measured(RV40, course_of(RV40, bench), bench, np.random.default_rng(1))
    assert trace.t_s is not None
    assert trace.segment is not None
    time = trace.t_s.copy()
    borders = np.concatenate(([0], np.flatnonzero(np.diff(trace.segment)) + 1, [trace.segment.size]))
    for start, stop in pairwise(borders.tolist()):
        if trace.segments[int(trace.segment[start])].role == "dwell":
            time[start + 1 : stop - 1] = time[stop - 1] if kept == 0 else time[start]
    result = judged(replace(trace, t_s=time), bench)
    assert ("creep_back" in failed(result)) is seen
    if seen:
        assert result.verdict is Verdict.NOT_DECIDABLE


@pytest.mark.parametrize("dwell_s", [0.5, 0.0])
@pytest.mark.parametrize(("arcmin", "per_turn"), [(-20.0, 60.0), (-10.0, 60.0), (10.0, 128.0), (-10.0, 128.0)])
def test_an_error_of_the_encoder_that_comes_often_in_its_turn_is_seen(
    arcmin: float, per_turn: float, dwell_s: float
) -> None:
    """60 in a turn, 20 arcmin at the input: a backlash of 1.14 read 0.845 and passed, and 10 arcmin made it 0.993."""
    bench = Bench(dwell_s=dwell_s, cycles=2)
    course = course_of(with_backlash(RV40, 1.14, 1.1 * RV40.rated_nm), bench)
    defect = Defect(ripple_arcmin=arcmin, ripple_per_turn=per_turn)
    result = judged(measured(RV40, course, bench, np.random.default_rng(1), defect), bench)
    assert "angle_waves" in failed(result)
    assert result.verdict is Verdict.NOT_DECIDABLE


@pytest.mark.parametrize(("arcmin", "per_turn"), [(20.0, 36.0), (-20.0, 36.0)])
def test_half_a_wave_in_the_loading_branch_is_seen(arcmin: float, per_turn: float) -> None:
    """20 arcmin, 36 in a turn: a backlash of 1.14 read 0.93 and passed, for a cubic follows less than a wave."""
    assert "angle_waves" in failed(rippled(arcmin, per_turn, drive=False))


@pytest.mark.parametrize(("arcmin", "per_turn"), [(60.0, 8.0), (-60.0, 8.0), (30.0, 16.0)])
def test_a_slow_wave_is_seen_by_the_drive_alone(arcmin: float, per_turn: float) -> None:
    """Less than half a wave bends the loop into that of another unit: only a second encoder can tell."""
    assert "drive_angle_agreement" in failed(rippled(arcmin, per_turn))
    assert not failed(rippled(arcmin, per_turn, drive=False))


def rippled(arcmin: float, per_turn: float, *, drive: bool = True) -> Result:
    bench = Bench(cycles=2)
    defect = Defect(ripple_arcmin=arcmin, ripple_per_turn=per_turn)
    trace = measured(RV40, course_of(RV40, bench), bench, np.random.default_rng(1), defect)
    return judged(trace if drive else replace(trace, drive_angle_rad=None), bench)


def test_angles_that_are_coarse_or_noisy_are_no_waves() -> None:
    """Rounding to a fortieth of the wind-up is a wave too, as long as a step; the uncertainty has it."""
    bench = Bench(cycles=2, dwell_s=0.0)
    trace = measured(RV40, course_of(RV40, bench), bench, np.random.default_rng(1))
    step = 0.2 * ARCMIN_RAD * RV40.ratio
    noise = np.random.default_rng(2).normal(0.0, step, trace.t_s.size)
    for angle in (np.round(trace.angle_in_rad / step) * step, trace.angle_in_rad + noise):
        assert "angle_waves" not in failed(judged(replace(trace, angle_in_rad=angle), bench))


@pytest.mark.parametrize(
    ("kind", "threshold", "peak"), [("RV-20E", 0.3, 0.6), ("RV-50", 0.3, 1.1), ("RV-40E", 0.15, 0.3)]
)
def test_friction_that_still_reverses_is_no_wave(kind: str, threshold: float, peak: float) -> None:
    """What a play of much friction leaves in the loading branch was a wave of 0.2 to 0.3 % of the wind-up."""
    unit, bench = replace(KINDS[kind], threshold=(0.02, threshold)), Bench(cycles=2, peak=peak, rate_per_s=0.3)
    trace = measured(unit, course_of(unit, bench), bench, np.random.default_rng(1))
    method = method_of(unit, bench, reference_torque_nm=unit.rated_nm * peak / 1.1)
    assert "angle_waves" not in failed(analyse(trace, method, BACKLASH, figures=figures_of(unit)))


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
