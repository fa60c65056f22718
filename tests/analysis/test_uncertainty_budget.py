"""The budget of a metric: against the formula of the loop width, against Monte Carlo, and for few cycles."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from reference_unit import Bench, ReferenceUnit, bench_trace, exact_trace

from analysis import (
    METRICS,
    AnalysisError,
    AngleFigures,
    Decision,
    LineCovariance,
    Method,
    MetricResult,
    MetricWanted,
    SensorFigures,
    TorqueFigures,
    analyse,
)
from analysis.evaluate import evaluate
from analysis.metric_result import SideValue
from analysis.pipeline import measure
from analysis.quadrants import Leftover
from analysis.uncertainty.budget import STUDENT
from analysis.uncertainty.circumstances import Points, circumstances_of
from analysis.uncertainty.distributions import DISTRIBUTIONS
from analysis.uncertainty.repeatability import CONFIDENCE, enlarged, student_factor
from analysis.uncertainty.sources import ROUNDINGS, SOURCES, Setting
from analysis.uncertainty.transfer import transfer_moves
from analysis.units import ARCMIN_PER_RAD

RATIO = 121.0
METHOD = Method(ratio=RATIO, rated_torque_nm=412.0, fixture_stiffness_nm_per_arcmin=1e4)
CALIBRATED = dataclasses.replace(METHOD, output_torque="calibrated")
UNIT = ReferenceUnit()
TRACE = bench_trace(UNIT, 453.2, cycles=2)
QUIET = bench_trace(
    UNIT,
    453.2,
    cycles=2,
    bench=Bench(torque_out_noise_nm=0.0, torque_in_noise_nm=0.0, angle_in_bits=None, angle_out_bits=None),
)
NO_ERRORS = {"gain_fraction": 0.0, "zero_fraction": 0.0, "reversibility_fraction": 0.0, "noise_fraction": 0.0}
FIGURES = SensorFigures(
    torque_in=TorqueFigures(5.0),
    torque_out=TorqueFigures(1000.0),
    angle_in=AngleFigures(2 * math.pi / 2**20),
    angle_out=AngleFigures(2 * math.pi / 2**23, accuracy_rad=1e-5, interpolation_rad=5e-7),
    skew_s=2e-4,
    drift_arcmin_per_min=0.005,
    fixture_fraction=0.05,
    lock_width_arcmin=0.002,
    lock_windup_fraction=5e-4,
)
CERTIFIED = dataclasses.replace(
    FIGURES,
    torque_in=TorqueFigures(5.0, stated_by="certificate"),
    torque_out=TorqueFigures(1000.0, stated_by="certificate"),
)
NO_NOISE = dataclasses.replace(
    FIGURES,
    torque_in=dataclasses.replace(FIGURES.torque_in, noise_fraction=0.0),
    torque_out=dataclasses.replace(FIGURES.torque_out, noise_fraction=0.0),
)
EVERY = [MetricWanted(name) for name in METRICS]


def metric(name: str, figures: SensorFigures | None, method: Method = METHOD, trace: object = QUIET) -> MetricResult:
    return analyse(trace, method, [MetricWanted(name)], figures=figures).metrics[0]


def evaluate_magnitude(name: str, estimate: Callable[..., float]) -> SideValue:
    """Evaluate a metric whose estimator gives what it is told, for one loop after the other."""
    row = METRICS[name]._replace(estimate=estimate, sides=METRICS[name].sides[:1])
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(METRICS, name, row)
        loops = measure(QUIET, METHOD).loops[:1] * 3
        found = evaluate(MetricWanted(name), loops, AnalysisError("none"), METHOD, Decision(), invalid=False)
    return found.headline


def contributions(found: MetricResult) -> dict[str, float]:
    return {row.quantity: row.contribution for row in found.headline.budget.rows}


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
    apart_min = (2 * 453.2 + 2 * 12.36) / 60.0 / 60.0  # down from +12.36 to -453.2 and up again; the dwell beside it
    assert found["drift"] == pytest.approx((apart_min + 0.1 / 60) * 0.005 * third, rel=0.1)
    assert found["lock_width"] == pytest.approx(0.002 * third)


def test_encoder_at_two_angles_counts_twice_when_they_are_half_a_period_apart() -> None:
    """2 u²_enc for errors that do not know of each other; between two angles of one sine it is 2 u² (1 − cos Δ)."""
    width_rad = metric("backlash_width_3pct", FIGURES).headline.value / 60 / 180 * math.pi * RATIO
    limit = 1e-5
    for periods in (0.5, 0.25):
        line = width_rad / periods
        encoder = AngleFigures(line / 512, accuracy_rad=0.0, interpolation_rad=limit)
        figures = SensorFigures(torque_out=TorqueFigures(1000.0, **NO_ERRORS), angle_in=encoder)
        u = limit / math.sqrt(6) / RATIO * 180 / math.pi * 60
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


def test_input_sensor_cancels_where_it_was_calibrated_in_the_same_run() -> None:
    """Gain and zero of the input sensor are in the lines and in the conversion, and go out again."""
    figures = SensorFigures(torque_in=TorqueFigures(5.0), torque_out=TorqueFigures(1000.0, **NO_ERRORS))
    found = contributions(metric("windup", figures, CALIBRATED))
    assert found.get("torque_in_gain", 0.0) < 1e-9
    assert found.get("torque_in_zero", 0.0) < 1e-9


def test_output_sensor_enters_a_converted_torque_through_the_lines() -> None:
    gain = SensorFigures(
        torque_in=TorqueFigures(5.0),
        torque_out=dataclasses.replace(TorqueFigures(1000.0, **NO_ERRORS), gain_fraction=1e-3),
    )
    direct = contributions(metric("windup", gain))["torque_out_gain"]
    assert contributions(metric("windup", gain, CALIBRATED))["torque_out_gain"] == pytest.approx(direct, rel=0.03)


def test_stored_lines_bring_their_covariance_and_another_zero() -> None:
    measured = analyse(QUIET, CALIBRATED, [MetricWanted("windup")]).quadrants
    stored = dataclasses.replace(CALIBRATED, quadrants=dataclasses.replace(measured, fits={}))
    u = LineCovariance(u_offset_nm=0.5, u_slope=0.3, correlation=-0.87)
    figures = dataclasses.replace(FIGURES, calibration={"load_positive": u})
    found, measured_here = (contributions(metric("stiffness_50_100", figures, one)) for one in (stored, CALIBRATED))
    assert found["torque_in_zero"] > 1e-3
    assert measured_here.get("torque_in_zero", 0.0) < 1e-9
    torque_in = (412.0 - measured.load_positive.offset_nm) / measured.load_positive.slope
    u_torque = math.sqrt(0.5**2 + (0.3 * torque_in) ** 2 - 2 * 0.87 * 0.5 * 0.3 * torque_in)
    row = next(row for row in metric("windup", figures, stored).headline.budget.rows if "calibration" in row.quantity)
    assert row.u == pytest.approx(u_torque)


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
    row, side = METRICS[name], METRICS[name].sides[0]
    calls = iter([-0.3, 0.1, -0.1])
    found = evaluate_magnitude(name, lambda *_: next(calls))
    assert row.estimate is not None
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


def test_what_a_calibration_leaves_over_is_as_large_between_its_bins_as_in_them() -> None:
    """Zero torque lies between two bins: errors of unlike sign were averaged there, and U of the loop at zero small."""
    found = measure(TRACE, CALIBRATED)
    circumstances, loop = circumstances_of(found), found.loops[0]
    _, moves = transfer_moves(loop, circumstances, SensorFigures())
    for side, branch, direction in ((0, loop.forward, 1), (1, loop.backward, -1)):
        left = found.quadrants.left[direction]
        over = left.fine_error_nm - np.interp(left.fine_torque_nm, left.torque_nm, left.error_nm)
        fine, own = (
            np.abs(torque[:, None] - left.torque_nm).argmin(axis=1)
            for torque in (left.fine_torque_nm, branch.torque_nm)
        )
        u = np.sqrt(sum(np.square(move[side][0]) for move in moves))
        about_zero = np.flatnonzero(np.abs(branch.torque_nm) < 10.0)
        assert about_zero.size > 2
        for point in about_zero:
            expected = np.sqrt(np.mean(np.square(over[fine == own[point]])))
            assert u[point] == pytest.approx(expected)


def test_a_corrected_conversion_has_the_errors_of_the_output_sensor_and_none_of_the_input() -> None:
    """Found by the coverage study: a line carried the reversibility to zero a sixth larger than the correction left it.

    U of a width was too large by that, and stiffness at high torque had too little of it.
    """
    converted, measured = (metric("backlash_width_3pct", FIGURES, method) for method in (CALIBRATED, METHOD))
    found, direct = contributions(converted), contributions(measured)
    assert not any(name.startswith("torque_in") for name in found)
    for name in ("torque_out_gain", "torque_out_zero", "torque_out_reversibility"):
        assert found[name] == pytest.approx(direct[name], rel=0.05, abs=2e-6), name


def test_noise_of_the_calibration_counts_as_the_mean_of_a_bin_has_it() -> None:
    """Bins of nothing but noise: fine ones show more of it than the correction, their mean, carries."""
    random, found = np.random.default_rng(3), measure(TRACE, CALIBRATED)
    quiet = dataclasses.replace(NO_NOISE, torque_out=dataclasses.replace(FIGURES.torque_out, noise_fraction=1e-4))
    fine_torque = (np.arange(960) + 0.5) * 0.9 - 432.0
    fine_error = random.normal(0.0, 0.1 / math.sqrt(16.0), 960)  # 0.1 N·m per sample, 16 samples per fine bin
    bins = [np.mean(values.reshape(-1, 4), axis=1) for values in (fine_torque, fine_error)]
    left = Leftover(*bins, np.full(240, 64.0), fine_torque, fine_error, np.full(960, 16.0))
    noisy = dataclasses.replace(found, quadrants=dataclasses.replace(found.quadrants, left={1: left, -1: left}))
    u, _ = transfer_moves(found.loops[0], circumstances_of(noisy), quiet)
    u_unknown, _ = transfer_moves(found.loops[0], circumstances_of(noisy), NO_NOISE)
    assert u_unknown == pytest.approx(0.1 * math.sqrt(1.0 / 16.0 - 1.0 / 64.0), rel=0.1)
    assert 0.1 / math.sqrt(64.0) <= u < 0.85 * u_unknown


def test_tables_are_complete() -> None:
    ids = [source.id for source in SOURCES]
    assert len(ids) == len(set(ids))
    for source in SOURCES:
        assert {source.distribution(figures) for figures in (FIGURES, CERTIFIED, SensorFigures())} <= set(DISTRIBUTIONS)
        assert source.text
        assert source.unit
        assert source.shapes


@pytest.mark.parametrize("name", list(DISTRIBUTIONS))
def test_draws_have_the_standard_uncertainty_of_their_distribution(name: str) -> None:
    row = DISTRIBUTIONS[name]
    components = {"cyclic": 2, "quantised": ROUNDINGS}.get(name, 1)
    drawn = row.draw(np.random.default_rng(5), 3.0, 200_000, components)
    assert drawn.shape == (200_000, components)
    assert drawn.std(axis=0) == pytest.approx(3.0 / row.divisor, rel=0.01)


def rounding_between(counts: float, figures: SensorFigures) -> float:
    """Standard deviation, in counts, of the rounding of two places of the locked shaft that are so far apart."""
    step_nm = FIGURES.angle_out.step_rad * ARCMIN_PER_RAD * METHOD.fixture_stiffness_nm_per_arcmin
    torque = np.array([0.0, counts * step_nm])
    points = Points(torque, torque / 100.0, 1, None, 0.0, None, 0.0)
    setting = Setting(points, circumstances_of(measure(QUIET, METHOD)), figures)
    (source,) = [one for one in SOURCES if one.id == "angle_out_step"]
    apart = [np.diff(shape(setting).angle_arcmin)[0] * 60.0 for shape in source.shapes]
    return math.hypot(*apart) / math.sqrt(12.0)


EXACT_SHAFT = dataclasses.replace(
    FIGURES, angle_out=dataclasses.replace(FIGURES.angle_out, interpolation_rad=0.0), fixture_fraction=0.0
)


@pytest.mark.parametrize("counts", [0.0, 0.25, 0.5, 0.75, 1.0, 16.0, 16.25])
def test_two_readings_of_an_encoder_differ_by_its_rounding(counts: float) -> None:
    """Two places so many counts apart, anywhere on the scale: rounding makes d or d - 1 of a distance of d counts."""
    part = counts % 1.0
    assert rounding_between(counts, EXACT_SHAFT) == pytest.approx(math.sqrt(part * (1.0 - part)), rel=0.12, abs=1e-6)


@pytest.mark.parametrize("without", ["interpolation", "fixture"])
def test_places_some_counts_apart_are_not_rounded_alike(without: str) -> None:
    """Found by the coverage study: 206 and 412 N·m are eight counts apart, and the error within a line moves them."""
    encoder = dataclasses.replace(FIGURES.angle_out, interpolation_rad=math.radians(0.5 / 3600.0))
    figures = dataclasses.replace(FIGURES, angle_out=encoder, fixture_fraction=0.0)
    if without == "interpolation":
        figures = dataclasses.replace(EXACT_SHAFT, fixture_fraction=0.05)
    assert rounding_between(16.0, figures) == pytest.approx(math.sqrt(1.0 / 6.0), rel=0.35)
    assert rounding_between(0.0, figures) == 0.0


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: TorqueFigures(0.0),
        lambda: TorqueFigures(5.0, gain_fraction=-1e-3),
        lambda: AngleFigures(math.nan),
        lambda: LineCovariance(0.1, 0.1, 1.5),
        lambda: SensorFigures(skew_s=-1e-3),
        lambda: TorqueFigures(5.0, stated_by="hearsay"),
    ],
)
def test_figures_that_make_no_sense_are_refused(wrong: object) -> None:
    with pytest.raises(AnalysisError, match="found"):
        wrong()


@pytest.mark.parametrize("arcmin_per_min", [0.1, 0.3])
def test_a_drift_that_one_cycle_cannot_show_is_in_the_uncertainty(arcmin_per_min: float) -> None:
    """Found by an adversary: the loop reads narrow, no gate fires below its limit, and U knew nothing of it."""
    trace = bench_trace(UNIT, 453.2, cycles=1)
    true = metric("backlash_width_3pct", FIGURES, trace=trace).headline.value
    creep = trace.t_s * (arcmin_per_min / 60.0 / ARCMIN_PER_RAD)
    drifted = dataclasses.replace(trace, angle_in_rad=trace.angle_in_rad + creep * RATIO)
    found = metric("backlash_width_3pct", FIGURES, trace=drifted)
    assert abs(found.headline.value - true) < found.headline.uncertainty
    assert contributions(found)["drift_unseen"] > contributions(found)["drift"]


def test_two_cycles_show_their_drift_themselves() -> None:
    assert "drift_unseen" not in contributions(metric("backlash_width_3pct", FIGURES, trace=TRACE))
