"""A ramp that was held, ran over or was set back: its stretch is left out, and what it leaves is in U."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.evaluation.pipeline import Result, analyse
from analysis.evaluation.verdict import Verdict
from analysis.loop.method import Decision, MetricWanted
from benchmarks.simulated.kinds import KINDS, Kind
from benchmarks.simulated.loop_generator import Bench, Hold, course_of, figures_of, measured, method_of
from benchmarks.simulated.truth import truth

RV40 = KINDS["RV-40E"]
WANTED = (
    MetricWanted("backlash_width_3pct", max=2.0),
    MetricWanted("stiffness_50_100", branch="load", min=20.0),
    MetricWanted("stiffness_lsq", min=20.0),
    MetricWanted("hysteresis_energy", max=5000.0),
)
PLACES = [(branch, share) for branch in (0, 1) for share in (0.03, 0.3, 0.55, 0.93)]
"""Branch (0 falling, 1 rising) and share of its way."""


def judged(unit: Kind, bench: Bench) -> Result:
    trace = measured(unit, course_of(unit, bench), bench, np.random.default_rng(1))
    return analyse(trace, method_of(unit, bench), WANTED, Decision("guard_band"), figures=figures_of(unit))


def beyond(unit: Kind, bench: Bench, result: Result) -> list[str]:
    """Metrics that pass and are further from the truth than U and a tenth."""
    found = []
    for wanted, metric in zip(WANTED, result.metrics, strict=True):
        name = f"{wanted.id} {wanted.branch}" if wanted.branch else wanted.id
        for side in metric.sides:
            exact = truth(unit, name, -1 if side.side == "-" else 1, bench.peak * unit.rated_nm)
            if side.verdict is Verdict.PASS and abs(side.value - exact) > 1.1 * side.uncertainty:
                found.append(f"{name} {side.side}: {side.value:.5g} ± {side.uncertainty:.2g}, true {exact:.5g}")
    return found


HELD = (
    Hold(0, 0.0),
    Hold(0, 0.0, rest_s=0.1, creep_arcmin=0.02),
    Hold(0, 0.0, overshoot_nm=7.0, creep_arcmin=0.01),
)
"""A rest, one with creep, an overshoot that is set back; they take turns over the places."""


def test_no_placement_passes_beyond_its_uncertainty() -> None:
    """A hold at 403 N·m made a stiffness of 104.9 read 103.76 ± 0.21, and pass."""
    wrong, left_out = [], 0
    for number, (branch, share) in enumerate(PLACES):
        hold = HELD[number % len(HELD)]
        bench = Bench(cycles=1, calibrate=False, holds=(replace(hold, branch=branch, share=float(share)),))
        result = judged(RV40, bench)
        wrong += [f"{branch} {share:.2f}: {text}" for text in beyond(RV40, bench, result)]
        left_out += any(stage.name == "interruptions" for stage in result.stages)
    assert wrong == []
    assert left_out == len(PLACES)


def test_a_step_that_alone_lets_a_value_pass_decides_nothing() -> None:
    """Without figures of the sensors the step is in no budget."""
    bench = Bench(cycles=2, calibrate=False, holds=(Hold(1, 0.75, creep_arcmin=-0.05),))
    trace = measured(RV40, course_of(RV40, bench), bench, np.random.default_rng(1))
    sound = replace(bench, holds=())
    stiff = [
        analyse(seen, method_of(RV40, bench), [MetricWanted("stiffness_50_100", branch="load", side="+")])
        for seen in (trace, measured(RV40, course_of(RV40, sound), sound, np.random.default_rng(1)))
    ]
    held, clean = (one.metrics[0].headline.value for one in stiff)
    limit = MetricWanted("stiffness_50_100", branch="load", side="+", min=(held + clean) / 2.0)
    result = analyse(trace, method_of(RV40, bench, check_limits={"width_growth": 100.0}), [limit])
    assert result.verdict is Verdict.NOT_DECIDABLE
    assert "interrupted ramps" in result.reasons[0]


def test_a_ramp_that_was_interrupted_for_long_is_not_judged() -> None:
    bench = Bench(cycles=1, calibrate=False, holds=(Hold(1, 0.6, overshoot_nm=40.0),))
    assert "interrupted" in [check.id for check in judged(RV40, bench).checks if check.passed is False]
