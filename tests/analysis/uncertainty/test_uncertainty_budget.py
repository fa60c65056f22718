"""The budget of a metric: against the formula of the loop width, against Monte Carlo, and for few cycles."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from budget_support import CALIBRATED, CERTIFIED, METHOD, NO_ERRORS, QUIET, TRACE, UNIT, contributions, metric
from reference_unit import FIGURES, RATIO, Bench, ReferenceUnit, bench_trace, exact_trace

from analysis.evaluation.evaluate import evaluate
from analysis.evaluation.metric_result import SideValue
from analysis.evaluation.pipeline import analyse
from analysis.loop.measured import measure
from analysis.loop.method import Decision, Method, MetricWanted
from analysis.metrics.estimators import ESTIMATORS
from analysis.trace.errors import AnalysisError
from analysis.uncertainty.budget import STUDENT
from analysis.uncertainty.distributions import DISTRIBUTIONS
from analysis.uncertainty.figures import AngleFigures, SensorFigures, TorqueFigures
from analysis.uncertainty.scatter import CONFIDENCE, enlarged, student_factor
from definitions.metrics import METRICS
from definitions.units import ARCMIN_PER_RAD

EVERY = [MetricWanted(name) for name in METRICS]


def evaluate_magnitude(name: str, estimate: Callable[..., float]) -> SideValue:
    """Evaluate a metric whose estimator gives what it is told, for one loop after the other."""
    row = METRICS[name]._replace(sides=METRICS[name].sides[:1])
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(METRICS, name, row)
        patch.setitem(ESTIMATORS, name, estimate)
        loops = measure(QUIET, METHOD).loops[:1] * 3
        found = evaluate(MetricWanted(name), loops, AnalysisError("none"), METHOD, Decision(), invalid=False)
    return found.headline


def test_every_metric_has_a_budget_whose_shares_are_one() -> None:
    for found in analyse(TRACE, METHOD, EVERY, figures=FIGURES).metrics:
        plain = found.to_dict()
        assert plain["uncertainty_kind"] == "budget"
        for side in found.sides:
            rows = side.budget.rows
            assert side.budget.u > 0
            if not found.definition.graded:  # a grade counts in whole steps; its budget is that of its backlash
                assert side.uncertainty == 2 * side.budget.u
            assert sum(row.share for row in rows) == pytest.approx(1.0)
            assert math.hypot(*(row.contribution for row in rows)) == pytest.approx(side.budget.u)
            assert all(row.contribution == pytest.approx(abs(row.sensitivity) * row.u) for row in rows)
            assert plain["sides"][side.side]["budget"] == side.budget_rows
        assert plain["budget"] == found.headline.budget_rows
        assert set(plain["budget"][0]) == {
            "quantity", "text", "distribution", "u", "unit", "sensitivity", "contribution", "share"
        }  # fmt: skip
        assert {row.distribution for row in found.headline.budget.rows} <= {*DISTRIBUTIONS, STUDENT}


def slopes(torque: float) -> tuple[float, float]:
    """1/K of the forward and of the return branch of the exact loop at a torque, arcmin per N·m."""
    phi, rising, falling = UNIT.branches(453.2)
    at = np.array([torque - 0.5, torque + 0.5])
    return float(np.diff(np.interp(at, rising, phi))[0]), float(np.diff(np.interp(at, falling, phi))[0])


def test_loop_width_agrees_with_its_formula_term_by_term() -> None:
    """u²(B) = 2u²_enc + (1/K_r − 1/K_f)² u²(T_off) + (1/K_r + 1/K_f)² u²(T_rev) + (2ω)² u²(Δτ) + (Δt u_drift)²."""
    forward, backward = slopes(12.36)
    found = contributions(metric("backlash_width_3pct", FIGURES))
    third = 1 / math.sqrt(3)
    lens = 1 - (12.36 / 453.2) ** 2
    # a difference of two slopes that are nearly the same, on branches with a torque every 2 N·m
    assert found["torque_out_zero"] == pytest.approx(abs(backward - forward) * 0.2 * third, rel=0.15)
    assert found["torque_out_gain"] == pytest.approx(abs(backward - forward) * 12.36e-3 * third, rel=0.15)
    assert found["torque_out_reversibility"] == pytest.approx((backward + forward) * 0.2 * lens * third, rel=0.03)
    # ω differs between the branches: the rate of torque over the stiffness of each
    assert found["skew"] == pytest.approx((forward + backward) * 60.0 * 2e-4 * third, rel=0.03)
    # from +12.36 N·m to zero up, from there to -453.2 N·m and back down, up again to +12.36: not what falls besides
    creeping_min = (2 * 453.2 - 2 * 12.36) / 60.0 / 60.0
    assert found["creep"] == pytest.approx(creeping_min * 0.005 * third, rel=0.03)
    assert found["lock_width"] == pytest.approx(0.002 * third)


def test_encoder_at_two_angles_counts_twice_when_they_are_half_a_period_apart() -> None:
    """2 u²_enc for errors that do not know of each other; between two angles of one sine it is 2 u² (1 − cos Δ)."""
    width_rad = metric("backlash_width_3pct", FIGURES).headline.value / 60 / 180 * math.pi * RATIO
    limit = 1e-5
    for periods in (0.5, 0.25):
        line = width_rad / periods
        encoder = AngleFigures(line / 512, accuracy_rad=0.0, interpolation_rad=limit)
        figures = SensorFigures(torque_out=TorqueFigures(1000.0, **NO_ERRORS), angle_in=encoder)
        u = limit / math.sqrt(2) / RATIO * 180 / math.pi * 60
        expected = u * math.sqrt(2 * (1 - math.cos(2 * math.pi * periods)))
        assert contributions(metric("backlash_width_3pct", figures))["angle_in_line"] == pytest.approx(
            expected, rel=0.02
        )


def test_gain_of_the_torque_goes_into_a_stiffness_that_is_even() -> None:
    """A straight unit: stiffness is as wrong as the torque, whatever its definition."""
    straight = ReferenceUnit(b=0.0, j=0.0, f_c=1.0)
    trace = exact_trace(straight, 480.0, points=3001)
    figures = SensorFigures(torque_out=dataclasses.replace(TorqueFigures(1000.0, **NO_ERRORS), gain_fraction=1e-3))
    for name in ("stiffness_lsq", "stiffness_two_point", "stiffness_50_100", "stiffness_at", "spring_constant"):
        side = metric(name, figures, trace=trace).headline
        assert side.budget.u / side.value == pytest.approx(1e-3 / math.sqrt(3), rel=1e-2), name


def test_offset_error_of_the_fixture_enters_only_where_it_is_corrected() -> None:
    assert "fixture" not in contributions(metric("windup", FIGURES))
    alone = dataclasses.replace(QUIET, angle_out_rad=None)
    found = contributions(metric("windup", FIGURES, trace=alone))
    assert found["fixture"] == pytest.approx(2 * 412 / 1e4 * 0.05 / math.sqrt(3), rel=1e-2)


def test_without_figures_it_is_repeatability_and_the_result_says_so() -> None:
    result = analyse(TRACE, METHOD, [MetricWanted("windup")])
    side = result.metrics[0].headline
    expected = student_factor(1) * side.standard_deviation / math.sqrt(2)
    assert side.uncertainty == pytest.approx(expected)
    assert side.uncertainty_kind == "repeatability"
    assert [row.quantity for row in side.budget.rows] == ["repeatability"]
    assert any("repeatability only" in note for note in result.notes)


def test_one_cycle_has_an_uncertainty_only_with_figures() -> None:
    one = bench_trace(UNIT, 453.2, cycles=1)
    assert metric("windup", None, trace=one).headline.uncertainty is None
    with_figures = metric("windup", FIGURES, trace=one)
    assert with_figures.headline.uncertainty > 0
    assert "repeatability" not in contributions(with_figures)
    guarded = analyse(one, METHOD, [MetricWanted("windup", max=10.0)], Decision("guard_band"), figures=FIGURES)
    assert guarded.verdict == "PASS"


@pytest.mark.parametrize(("freedom", "factor"), [(1, 13.968), (2, 4.527), (3, 3.307), (9, 2.320), (math.inf, 2.0)])
def test_student_factors_of_few_cycles(freedom: float, factor: float) -> None:
    """GUM table G.2, 95.45 %."""
    assert student_factor(freedom) == pytest.approx(factor, abs=1e-3)


def test_scatter_that_is_small_beside_what_is_known_needs_no_factor() -> None:
    assert enlarged(1.0, 0.01, 2) == pytest.approx(0.01, rel=1e-3)
    assert enlarged(0.0, 0.01, 2) == pytest.approx(0.01 * 4.527 / 2, rel=1e-3)
    assert enlarged(1.0, 0.0, 2) == 0.0


def test_scatter_beyond_the_noise_is_counted() -> None:
    """A unit that changes from cycle to cycle: its noise cannot explain it."""
    angle = TRACE.angle_in_rad.copy()
    cycle = np.array([TRACE.segments[int(key)].cycle for key in TRACE.segment])
    angle[cycle == 2] *= 1.001
    rows = contributions(metric("windup", FIGURES, trace=dataclasses.replace(TRACE, angle_in_rad=angle)))
    calm = contributions(metric("windup", FIGURES, trace=TRACE))
    assert rows["repeatability"] > 20 * calm["repeatability"]


def test_noise_is_as_large_as_the_scatter_of_many_runs() -> None:
    """Predicted from the declared noise against 30 runs with other noise."""
    names = ["backlash_width_3pct", "stiffness_50_100", "spring_constant"]
    wanted = [MetricWanted(name) for name in names]
    bench = Bench(angle_in_bits=None, angle_out_bits=None, rate_nm_s=120.0)
    noise = {**NO_ERRORS, "noise_fraction": 2e-4}
    figures = SensorFigures(torque_out=TorqueFigures(1000.0, **noise))
    traces = [bench_trace(UNIT, 453.2, cycles=1, bench=bench, seed=seed) for seed in range(30)]
    values = [[found.headline.value for found in analyse(trace, METHOD, wanted).metrics] for trace in traces]
    predicted = [found.headline.budget.u for found in analyse(traces[0], METHOD, wanted, figures=figures).metrics]
    for name, expected, seen in zip(names, predicted, np.std(values, axis=0, ddof=1), strict=True):
        assert 0.6 < seen / expected < 1.6, name  # both are known to 13 % at best: three of it and a margin


@pytest.mark.parametrize("method", [METHOD, CALIBRATED], ids=["reaction", "calibrated"])
def test_monte_carlo_agrees_with_the_budget_where_the_metric_is_straight(method: Method) -> None:
    names = ["backlash_width_3pct", "stiffness_lsq", "stiffness_50_100", "spring_constant", "windup"]
    result = analyse(TRACE, method, [MetricWanted(name) for name in names], figures=FIGURES, draws=600)
    for found in result.metrics:
        side = found.headline
        drawn = side.budget.monte_carlo
        calm = math.hypot(*(row.contribution for row in side.budget.rows if row.quantity != "repeatability"))
        # 600 draws know a standard deviation to 3 %, an interval's end to about 6 %
        assert drawn.low < side.value < drawn.high
        if contributions(found).get("repeatability", 0.0) < 0.1 * calm:
            assert drawn.u == pytest.approx(calm, rel=0.1), found.wanted.id
            assert drawn.high - drawn.low == pytest.approx(4 * calm, rel=0.2), found.wanted.id
        assert found.to_dict()["monte_carlo"]["draws"] == 600
    again = analyse(TRACE, method, [MetricWanted(names[0])], figures=FIGURES, draws=600)
    assert again.metrics[0].headline.budget.monte_carlo == result.metrics[0].headline.budget.monte_carlo


def test_a_torque_ratio_is_drawn_from_its_line_and_its_sensors() -> None:
    wanted = [MetricWanted("torque_ratio_slope"), MetricWanted("torque_ratio_offset")]
    result = analyse(TRACE, CALIBRATED, wanted, figures=FIGURES, draws=4000)
    for found in result.metrics:
        for side in found.sides:
            drawn = side.budget.monte_carlo
            # 4000 draws know a standard deviation to 1.1 %
            assert drawn.u == pytest.approx(side.budget.u, rel=0.05), (found.wanted.id, side.side)
            assert drawn.low < side.value < drawn.high
            assert (drawn.low + drawn.high) / 2 == pytest.approx(side.value, abs=0.3 * drawn.u)
            assert side.drawn == found.to_dict()["sides"][side.side]["monte_carlo"]
    (alone,) = analyse(TRACE, CALIBRATED, wanted[:1], draws=4000).metrics
    fit = alone.headline.budget
    assert fit.monte_carlo.u == pytest.approx(fit.u, rel=0.05)
    (plain,) = analyse(TRACE, CALIBRATED, wanted[:1], figures=FIGURES).metrics
    assert plain.headline.budget.monte_carlo is None


MAGNITUDES = [name for name, row in METRICS.items() if row.magnitude]


def test_magnitude_near_zero_has_the_uncertainty_of_its_signed_quantity() -> None:
    """Sides that are alike have the contributions of sides that are not: the kink of |x| is not in them."""
    alike = metric("asymmetry_at_rated", FIGURES, trace=exact_trace(UNIT, 480.0, points=3001))
    assert alike.headline.value < alike.headline.uncertainty
    other = ReferenceUnit(negative_softer=0.97)
    unlike = metric("asymmetry_at_rated", FIGURES, trace=exact_trace(other, 480.0, points=3001))
    assert unlike.headline.value > 20 * unlike.headline.uncertainty
    first, second = contributions(alike), contributions(unlike)
    for name in ("torque_out_zero", "noise"):
        assert first[name] == pytest.approx(second[name], rel=0.05), name


@pytest.mark.parametrize("name", MAGNITUDES)
def test_a_magnitude_is_that_of_the_mean_and_not_the_mean_of_magnitudes(name: str) -> None:
    """Cycles on both sides of zero: what scatters about it has the size of the scatter."""
    side = METRICS[name].sides[0]
    calls = iter([-0.3, 0.1, -0.1])
    found = evaluate_magnitude(name, lambda *_: next(calls))
    assert side in ("both", "+")
    assert found.value == pytest.approx(0.1)
    assert found.per_cycle == pytest.approx((0.3, -0.1, 0.1))
    assert np.mean(found.per_cycle) == pytest.approx(found.value)
    assert found.standard_deviation == pytest.approx(np.std([-0.3, 0.1, -0.1], ddof=1))


def test_a_grade_by_the_wider_side_is_as_uncertain_as_a_side_where_both_are_alike() -> None:
    """The wider of two has a kink where they are alike: errors that widen one and narrow the other count there."""
    wanted = [MetricWanted("grade", variant="width_3pct"), MetricWanted("backlash_width_3pct")]
    graded, width = analyse(exact_trace(UNIT, 480.0, points=3001), METHOD, wanted, figures=FIGURES).metrics
    for quantity in ("torque_out_zero", "torque_out_gain"):
        of_grade, of_width = contributions(graded)[quantity], contributions(width)[quantity]
        assert of_grade == pytest.approx(of_width, rel=0.1), quantity


@pytest.mark.parametrize("method", [METHOD, CALIBRATED], ids=["reaction", "calibrated"])
def test_a_certificate_makes_gain_and_reversibility_smaller_and_nothing_else(method: Method) -> None:
    """The same figure is 2 u on a certificate and √3 u on a data sheet."""
    for name in ("windup", "backlash_width_3pct", "stiffness_lsq"):
        limits, certified = (metric(name, figures, method).headline.budget for figures in (FIGURES, CERTIFIED))
        assert certified.u < limits.u
        of_limits = {row.quantity: row for row in limits.rows}
        for row in certified.rows:
            before = of_limits[row.quantity]
            stated = row.quantity.startswith("torque_out") and not row.quantity.endswith("zero")
            stated |= row.quantity == "torque_in_reversibility"
            if stated:
                assert (before.distribution, row.distribution) == ("rectangular", "normal, k = 2")
                assert row.u == pytest.approx(before.u * math.sqrt(3) / 2)
                expected = before.contribution * math.sqrt(3) / 2
                assert row.contribution == pytest.approx(expected, rel=0.02, abs=0.01 * certified.u)
            elif row.quantity not in ("torque_in_gain", "repeatability"):
                assert row.distribution == before.distribution
                assert row.contribution == pytest.approx(before.contribution), row.quantity


def test_monte_carlo_draws_a_certificate_as_it_draws_its_budget() -> None:
    """One error alone: ± U covers 95 % of a certificate's, and all of a data sheet's."""
    only = dataclasses.replace(TorqueFigures(1000.0, **NO_ERRORS), gain_fraction=1e-3)
    for stated_by, ends in (("data_sheet", math.sqrt(3) * CONFIDENCE), ("certificate", 2.0)):
        figures = SensorFigures(torque_out=dataclasses.replace(only, stated_by=stated_by))
        wanted = [MetricWanted("windup")]
        trace = exact_trace(UNIT, 480.0, points=3001)
        budget = analyse(trace, METHOD, wanted, figures=figures, draws=2000).metrics[0].headline.budget
        half = (budget.monte_carlo.high - budget.monte_carlo.low) / 2
        assert half == pytest.approx(ends * budget.u, rel=0.05), stated_by


@pytest.mark.parametrize("arcmin_per_min", [0.1, 0.3])
def test_a_drift_that_one_cycle_cannot_show_is_in_the_uncertainty(arcmin_per_min: float) -> None:
    """Found by an adversary: the loop reads narrow, no check fires below its limit, and U knew nothing of it."""
    trace = bench_trace(UNIT, 453.2, cycles=1)
    true = metric("backlash_width_3pct", FIGURES, trace=trace).headline.value
    creep = trace.t_s * (arcmin_per_min / 60.0 / ARCMIN_PER_RAD)
    drifted = dataclasses.replace(trace, angle_in_rad=trace.angle_in_rad + creep * RATIO)
    found = metric("backlash_width_3pct", FIGURES, trace=drifted)
    assert abs(found.headline.value - true) < found.headline.uncertainty
    assert contributions(found)["drift_unseen"] > contributions(found)["creep"]


def test_two_cycles_show_their_drift_themselves() -> None:
    assert "drift_unseen" not in contributions(metric("backlash_width_3pct", FIGURES, trace=TRACE))


@pytest.mark.parametrize(("treated", "row"), [("correct", 0.0), ("report", 0.05)])
def test_a_drift_is_taken_out_or_it_is_in_the_uncertainty(treated: str, row: float) -> None:
    """What is left is the standard error of the drift, or the whole of it: 0.05 arcmin/min, 15 s between branches."""
    creep = TRACE.t_s * (0.05 / 60.0 / ARCMIN_PER_RAD)
    drifted = dataclasses.replace(TRACE, angle_in_rad=TRACE.angle_in_rad + creep * RATIO)
    true = metric("backlash_width_3pct", FIGURES, trace=TRACE).headline
    method = dataclasses.replace(METHOD, drift=treated)
    found = metric("backlash_width_3pct", FIGURES, trace=drifted, method=method)
    assert abs(found.headline.value - true.value) < found.headline.uncertainty
    assert contributions(found)["drift"] == pytest.approx(row * 15.4 / 60.0, rel=0.1, abs=2e-4)
