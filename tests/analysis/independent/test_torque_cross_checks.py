"""Torques and ratio that are wrong by some percent, more than U of a stiffness: a soft unit passed as a stiff one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.evaluation.pipeline import Result, analyse
from analysis.evaluation.verdict import Verdict
from analysis.loop.method import Decision, MetricWanted
from analysis.trace.trace import Trace
from benchmarks.simulated.kinds import KINDS, Kind
from benchmarks.simulated.loop_generator import SOUND, Bench, Defect, course_of, figures_of, measured, method_of
from benchmarks.simulated.truth import truth

RV40 = KINDS["RV-40E"]
SOFT = replace(RV40, spring_nm_per_arcmin=0.945 * RV40.spring_nm_per_arcmin)
STIFF = MetricWanted("stiffness_50_100", branch="load", min=108.0)


def seen(unit: Kind, bench: Bench, defect: Defect = SOUND, seed: int = 1) -> Trace:
    return measured(unit, course_of(unit, bench), bench, np.random.default_rng(seed), defect)


def judged(unit: Kind, bench: Bench, trace: Trace, wanted: MetricWanted, **method: object) -> Result:
    return analyse(trace, method_of(unit, bench, **method), [wanted], Decision("guard_band"), figures=figures_of(unit))


def of(result: Result, check: str) -> object:
    (found,) = [one for one in result.checks if one.id == check]
    return found


WRONG = {
    "gain of the output torque +4.5 %": (Defect(out_gain=1.045), {}, "ratio_agreement"),
    "gain of the output torque +2 %": (Defect(out_gain=1.02), {}, "ratio_agreement"),
    "gain of the output torque +4 % on one side": (Defect(out_gain_positive=1.04), {}, "ratio_agreement"),
    "gain of the output torque +1.8 % on one side": (Defect(out_gain_positive=1.018), {}, "ratio_agreement"),
    "gain of the input torque -4 %": (Defect(in_gain=0.96), {}, "ratio_agreement"),
    "ratio 126.5 in the recipe for 121": (SOUND, {"ratio": 126.5}, "ratio_agreement"),
    "torque bent by 4.5 %": (Defect(bend=0.045), {}, "torque_bend"),
    "torque bent by -3.5 %": (Defect(bend=-0.035), {}, "torque_bend"),
    "torque bent by 2 %": (Defect(bend=0.02), {}, "torque_bend"),
}
"""What is wrong, what the recipe has, and the check that must see it."""


@pytest.mark.parametrize("calibrate", [True, False])
@pytest.mark.parametrize("what", WRONG)
def test_torques_that_do_not_fit_each_other_are_not_judged(what: str, calibrate: bool) -> None:  # noqa: FBT001
    """A gain of 4.5 % in the output torque made 105.2 N·m/arcmin read 109.7 ± 0.14, and pass a limit of 108."""
    defect, method, check = WRONG[what]
    bench = Bench(calibrate=calibrate)
    result = judged(SOFT, bench, seen(SOFT, bench, defect), STIFF, **method)
    assert of(result, check).passed is False
    assert result.verdict is Verdict.NOT_DECIDABLE
    assert truth(SOFT, "stiffness_50_100 load", 1, bench.peak * SOFT.rated_nm) < 106.0


@pytest.mark.parametrize("peak", [1.1, 0.6, 0.3])
@pytest.mark.parametrize("kind", KINDS)
def test_no_sound_measurement_is_refused_at_any_load(kind: str, peak: float) -> None:
    """At 30 % of the load the unloading line lay in the transition: a zero 0.6 % off, a ratio 4.7 % to 38 %."""
    unit, bench = KINDS[kind], Bench(peak=peak)
    reference = unit.rated_nm * peak / 1.1
    for seed in (1, 2, 3):
        wanted = MetricWanted("backlash_width_3pct", max=4.0)
        result = judged(unit, bench, seen(unit, bench, seed=seed), wanted, reference_torque_nm=reference)
        assert [check.id for check in result.checks if check.passed is False] == []
        assert result.verdict is Verdict.PASS


def test_where_the_transition_does_not_end_nothing_is_told() -> None:
    unit, bench = KINDS["strain-wave"], Bench(peak=0.3)
    result = judged(unit, bench, seen(unit, bench), MetricWanted("windup"), reference_torque_nm=0.27 * unit.rated_nm)
    told = of(result, "ratio_agreement").text
    assert "most of the unloading branch is the transition after the turning point" in told
    for check in ("ratio_agreement", "torque_out_zero"):
        assert of(result, check).passed is None


@pytest.mark.parametrize("peak", [1.1, 0.6, 0.3])
@pytest.mark.parametrize("zero", [1.0, -1.0])
def test_a_zero_of_the_output_sensor_is_seen_at_a_small_load_too(peak: float, zero: float) -> None:
    """2 % of the reference torque; half of it is the limit, and what the lines are unsure of."""
    bench = Bench(peak=peak)
    reference = RV40.rated_nm * peak / 1.1
    trace = seen(RV40, bench)
    off = replace(trace, torque_out_nm=trace.torque_out_nm + 0.02 * zero * reference)
    result = judged(RV40, bench, off, MetricWanted("windup"), reference_torque_nm=reference)
    assert of(result, "torque_out_zero").passed is False
