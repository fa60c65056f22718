"""Risks of a decision rule: the worked example of JCGM 106, limits of what is possible, and the guard band wanted."""

import math
from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from analysis.evaluation.guard_band import Measured, gamma_process, guard_for, normal_process, risks, risks_of_each
from analysis.evaluation.verdict import Verdict, judge
from analysis.loop.method import Decision
from analysis.trace.errors import AnalysisError

PUBLISHED = gamma_process(4.0, 0.25)


def test_worked_example_of_jcgm_106() -> None:
    """JCGM 106, 9.5.4: upper limit 2, u = 0.25."""
    plain = risks(PUBLISHED, None, 2.0, 0.25)
    assert plain.false_accept == pytest.approx(0.0080191, abs=5e-8)
    assert plain.false_reject == pytest.approx(0.01744, abs=5e-6)
    guarded = risks(PUBLISHED, None, 2.0, 0.25, 0.32817)
    assert guarded.false_accept == pytest.approx(0.001, abs=5e-6)
    assert guarded.false_reject == pytest.approx(0.0755, abs=5e-5)


def test_guard_band_for_a_wanted_risk() -> None:
    assert guard_for(PUBLISHED, None, 2.0, 0.25, 0.001) == pytest.approx(0.32817, abs=5e-6)


@pytest.mark.parametrize("guard", [0.0, 0.1, -0.05])
def test_shares_are_those_of_drawn_parts(guard: float) -> None:
    """A million parts, drawn, measured, and judged by the rule that runs are judged by."""
    random = np.random.default_rng(7)
    true = random.normal(10.0, 0.4, 1_000_000)
    seen = true + random.normal(0.0, 0.1, true.size)
    good = (true >= 9.0) & (true <= 11.0)
    accepted = (seen >= 9.0 + guard) & (seen <= 11.0 - guard)
    failed = (seen < 9.0 - abs(guard)) | (seen > 11.0 + abs(guard))
    found = risks(normal_process(10.0, 0.4), 9.0, 11.0, 0.1, guard)
    shares = {
        "outside": ~good,
        "false_accept": ~good & accepted,
        "false_reject": good & ~accepted,
        "false_fail": good & failed,
    }
    for name, parts in shares.items():
        assert getattr(found, name) == pytest.approx(parts.mean(), abs=4e-4), name
    if guard >= 0.0:
        assert found.undecided == pytest.approx((~accepted & ~failed).mean(), abs=6e-4)
    rule = Decision("guard_band", max(guard, 0.0) / 0.2)
    for value in (9.05, 9.3, 10.95, 11.2):
        verdict = judge(value, 0.2, (9.0, 11.0), rule)[0]
        assert (verdict is Verdict.PASS) == (9.0 + max(guard, 0.0) <= value <= 11.0 - max(guard, 0.0))


def test_figures_beyond_the_numbers_are_refused_and_never_a_share_that_is_none() -> None:
    for mean, sd in ((1e308, 1e308), (-1e308, 1e308), (0.0, 1e307 * 17)):
        with pytest.raises(AnalysisError, match="numbers are too large"):
            normal_process(mean, sd)
    with pytest.raises(AnalysisError, match="process: gamma"):
        gamma_process(1.0, 1e308)
    fair = normal_process(1.0, 1.0)
    for guard in (math.nan, math.inf, -math.inf):
        with pytest.raises(AnalysisError, match="guard band: found"):
            risks(fair, None, 2.0, 1.0, guard)
    with pytest.raises(AnalysisError, match="u: found"):
        risks(fair, None, 2.0, 1e308)


@given(*[st.floats(allow_nan=True)] * 2, st.floats(min_value=0.0), st.floats(allow_nan=True))
@example(1e308, 1e308, 1.0, 0.0)
@example(0.0, 1.0, 5e-324, 0.0)
@example(1.0, 1.0, 1.0, 1.7e308)
@settings(max_examples=60, deadline=None)
@pytest.mark.filterwarnings("error")
def test_risks_are_numbers_or_refused(mean: float, sd: float, u: float, guard: float) -> None:
    try:
        found = risks(normal_process(mean, sd), None, 2.0, u, guard)
    except AnalysisError:
        return
    for name in ("outside", "false_accept", "false_reject", "false_fail", "undecided"):
        assert math.isfinite(getattr(found, name)), name


def test_values_that_were_measured_a_little_differently_are_not_taken_together() -> None:
    """By the mean of u and guard band the risks would be others."""
    process, values = normal_process(10.0, 0.4), [Measured(0.1 * 1.05**step, 0.05 * 1.05**step) for step in range(6)]
    each = [astuple(risks(process, 9.0, 11.0, *one)) for one in values]
    found = risks_of_each(process, 9.0, 11.0, values)
    assert astuple(found) == pytest.approx(np.mean(each, axis=0), rel=1e-9)


def test_a_sharp_measurement_makes_no_mistakes() -> None:
    found = risks(normal_process(10.5, 0.4), 9.0, 11.0, 1e-6)
    assert found.false_accept < 1e-6
    assert found.false_reject < 1e-6
    assert found.outside == pytest.approx(0.105650 + 8.84e-5, abs=1e-5)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: normal_process(1.0, 0.0),
        lambda: gamma_process(-1.0, 1.0),
        lambda: risks(PUBLISHED, None, None, 0.1),
        lambda: risks(PUBLISHED, None, 2.0, 0.0),
        lambda: risks(PUBLISHED, 1.0, 2.0, 0.25, 0.6),
        lambda: guard_for(PUBLISHED, None, 2.0, 0.25, 0.5),
    ],
)
def test_what_makes_no_sense_is_refused(wrong: object) -> None:
    with pytest.raises(AnalysisError, match=r"found|expected|limit|choose"):
        wrong()
