"""Output torque from the input torque: four quadrants, the transition after a reversal, and what one line does."""

import dataclasses

import numpy as np
import pytest
from reference_unit import FIGURES, ReferenceUnit, bench_trace
from scipy.signal import lfilter

from analysis.evaluation.pipeline import analyse
from analysis.evaluation.verdict import Verdict
from analysis.loop.method import Method, MetricWanted
from analysis.torque_ratio.quadrant_fit import fit_quadrants
from analysis.torque_ratio.quadrants import Quadrants, TorqueLine, output_torque
from analysis.trace.errors import AnalysisError
from analysis.trace.runs import commanded_runs
from analysis.trace.trace import Trace
from benchmarks.simulated.simulated_run import SimulatedBench, course_of
from benchmarks.simulated.simulated_unit import SimulatedUnit

METHOD = Method(ratio=121, rated_torque_nm=412, output_torque="calibrated")
WANTED = [
    MetricWanted("backlash_width_3pct"),
    MetricWanted("stiffness_50_100", branch="load"),
    MetricWanted("spring_constant"),
]
TRACE = bench_trace(ReferenceUnit(), 453.2, cycles=2)
QUADRANTS = fit_quadrants(TRACE, commanded_runs(TRACE))


def test_four_lines() -> None:
    for line, mirrored in (
        (QUADRANTS.load_positive, QUADRANTS.load_negative),
        (QUADRANTS.unload_positive, QUADRANTS.unload_negative),
    ):
        assert mirrored.offset_nm == pytest.approx(-line.offset_nm, abs=0.1)
        assert mirrored.slope == pytest.approx(line.slope, rel=1e-3)
    assert QUADRANTS.load_positive.offset_nm == pytest.approx(-13.9, abs=0.1)
    assert QUADRANTS.load_positive.slope == pytest.approx(94.7, abs=0.3)
    assert QUADRANTS.unload_positive.offset_nm == pytest.approx(24.8, abs=0.2)
    assert QUADRANTS.unload_positive.slope == pytest.approx(168, abs=0.5)


def test_transition_length_is_that_of_presliding() -> None:
    """Friction level over presliding stiffness, where the friction goes over: from the peak to 15 % below it."""
    unit = ReferenceUnit()
    lowest, highest = (
        (unit.input_friction_nm + unit.input_friction_slope * torque / 121) / unit.input_presliding
        for torque in (0.85 * 453.2, 453.2)
    )
    assert lowest < QUADRANTS.transition_rad < highest


def simulated(loading: float, unloading: float, zero_nm: float = 0.0) -> Trace:
    """One cycle without noise; the unit has unlike input frictions, the output sensor reads so much at zero torque."""
    unit = SimulatedUnit(friction_loading_nm=loading, friction_unloading_nm=unloading)
    bench = SimulatedBench(cycles=1)
    course = course_of(unit, bench)
    return Trace(
        torque_in_nm=course.torque_in_nm,
        torque_out_nm=course.torque_nm + zero_nm,
        angle_in_rad=(course.windup_arcmin + course.torque_nm / bench.fixture_nm_per_arcmin) * 121 * np.pi / 10_800,
        segment=course.segment,
        segments=course.segments,
    )


@pytest.mark.parametrize(("loading", "unloading"), [(0.12, 0.17), (0.17, 0.12)])
def test_friction_that_differs_between_loading_and_unloading(loading: float, unloading: float) -> None:
    """About zero torque both lines hold for the same input torque: the order in time decides."""
    trace = simulated(loading, unloading)
    runs = commanded_runs(trace)
    quadrants = fit_quadrants(trace, runs)
    for run in [run for run in runs if run.role == "measure"]:
        taken = (run.take(values) for values in (trace.torque_in_nm, trace.torque_out_nm, trace.angle_in_rad))
        torque_in, torque_out, turned = taken
        converted, _ = output_torque(quadrants, torque_in, run.direction, turned)
        error = np.abs(converted - torque_out)
        assert np.median(error) < 0.02
        assert error.max() < 1.0  # 7 N·m when both lines count


@pytest.mark.parametrize(("loading", "unloading"), [(0.12, 0.17), (0.17, 0.12)])
def test_friction_changes_sides_at_the_true_zero_and_not_at_that_of_the_sensor(
    loading: float, unloading: float
) -> None:
    """Found by the coverage study: in bins of converted torque, which stands still there, a width at zero was wrong."""
    trace, zero = simulated(loading, unloading, zero_nm=0.3), [MetricWanted("backlash_width_zero")]
    converted, measured = (
        analyse(trace, dataclasses.replace(METHOD, output_torque=torque), zero).metrics[0].headline.value
        for torque in ("calibrated", "reaction")
    )
    assert converted == pytest.approx(measured, abs=5e-4)


def test_where_the_angle_is_counted_from_does_not_matter() -> None:
    """Found by an adversary: angles of the cycles shifted by 0.01 rad moved the correction along the branch."""
    trace = bench_trace(ReferenceUnit(), 453.2)
    first = min(key for key, info in trace.segments.items() if info.role == "measure")
    cycles = np.arange(trace.segment.size) >= int(np.flatnonzero(trace.segment == first)[0])
    shifted = dataclasses.replace(trace, angle_in_rad=trace.angle_in_rad + 0.01 * cycles)
    spring = [analyse(one, METHOD, [MetricWanted("spring_constant")]).metrics[0] for one in (trace, shifted)]
    for side, moved in zip(*(metric.sides for metric in spring), strict=True):
        assert moved.value == pytest.approx(side.value, rel=2e-4)


def test_what_another_run_left_over_is_not_taken_off() -> None:
    """It stands by the angles of its run, and where those begin nobody knows in this one."""
    trace = simulated(0.12, 0.17)
    run = next(run for run in commanded_runs(trace) if run.role == "measure")
    torque_in, turned = run.take(trace.torque_in_nm), run.take(trace.angle_in_rad)
    own = fit_quadrants(trace, commanded_runs(trace))
    stored, bare = dataclasses.replace(own, fits={}), dataclasses.replace(own, left={})
    by_own, by_stored, by_lines = (
        output_torque(quadrants, torque_in, run.direction, turned)[0] for quadrants in (own, stored, bare)
    )
    assert by_stored == pytest.approx(by_lines, rel=1e-12)
    assert by_own != pytest.approx(by_lines, rel=1e-12)


def test_loop_from_input_torque() -> None:
    backlash, stiffness, spring = analyse(TRACE, METHOD, WANTED).metrics
    for side in backlash.sides:
        assert side.value == pytest.approx(0.94, abs=0.05)
    for side in stiffness.sides:
        assert side.value == pytest.approx(104.70, rel=0.02)
    for side in spring.sides:
        assert side.value == pytest.approx(115.17, rel=0.02)


def test_stored_calibration_without_transition_masks_it() -> None:
    stored = dataclasses.replace(METHOD, quadrants=dataclasses.replace(QUADRANTS, transition_rad=None, fits={}))
    result = analyse(TRACE, stored, WANTED)
    assert result.metrics[0].headline.value == pytest.approx(0.94, abs=0.05)
    assert result.metrics[1].headline.value == pytest.approx(104.70, rel=0.02)
    assert any("masked" in note and "masked, 0" not in note for note in result.notes)


def test_a_loop_that_the_mask_cuts_open_has_no_area() -> None:
    """Without the stretch after its reversals a loop loses a sixth of its area, which no uncertainty knew of."""
    wanted = [MetricWanted("hysteresis_energy", max=430.0)]
    masked = dataclasses.replace(METHOD, quadrants=dataclasses.replace(QUADRANTS, transition_rad=None, fits={}))
    (whole,), result = analyse(TRACE, METHOD, wanted).metrics, analyse(TRACE, masked, wanted)
    (cut,) = result.metrics
    assert whole.headline.value == pytest.approx(449.0, rel=0.03)
    assert (cut.headline.value, result.verdict) == (None, Verdict.NOT_DECIDABLE)
    assert "the loop is incomplete" in result.reasons[0]
    assert "measure the torque at the output" in result.reasons[0]


def test_what_a_fit_reads_in_the_masked_stretch_says_so_in_its_uncertainty() -> None:
    """The reference torque lies in what is masked: spring constant and wind-up are continued there, and not measured.

    Found by an adversary: the spring constant was six times its uncertainty from the truth, and the budget had no row.
    """
    wanted = [MetricWanted(name) for name in ("spring_constant", "windup", "backlash_width_3pct")]
    masked = dataclasses.replace(METHOD, quadrants=dataclasses.replace(QUADRANTS, transition_rad=None, fits={}))
    reaction = dataclasses.replace(METHOD, output_torque="reaction")
    true, found = (analyse(TRACE, method, wanted, figures=FIGURES).metrics for method in (reaction, masked))
    for one, other in zip(true[:2], found[:2], strict=True):
        for side, continued in zip(one.sides, other.sides, strict=True):
            assert abs(continued.value - side.value) <= continued.uncertainty
            assert continued.uncertainty > 3.0 * side.uncertainty
            assert continued.budget.rows[0].quantity == "masked"
    assert not any(row.quantity == "masked" and row.share > 0.1 for row in found[2].headline.budget.rows)
    assert not any(row.quantity == "masked" for row in true[0].headline.budget.rows)


def test_one_line_for_the_whole_loop_reads_a_wrong_backlash() -> None:
    """Converting the unloading branch by the loading line makes 0.94 arcmin read 1.7."""
    load = QUADRANTS.load_positive
    mirrored = TorqueLine(-load.offset_nm, load.slope)
    one_line = Quadrants(load, load, mirrored, mirrored)
    result = analyse(TRACE, dataclasses.replace(METHOD, quadrants=one_line), WANTED[:1])
    assert result.metrics[0].headline.value != pytest.approx(0.94, abs=0.3)


def test_torque_ratio_is_a_metric_with_the_uncertainty_of_its_fit() -> None:
    wanted = [MetricWanted("torque_ratio_slope"), MetricWanted("torque_ratio_offset", min=-25.0)]
    result = analyse(TRACE, dataclasses.replace(METHOD, output_torque="reaction"), wanted)
    slope, offset = result.metrics
    assert slope.headline.value == pytest.approx(QUADRANTS.load_positive.slope)
    assert slope.headline.uncertainty == pytest.approx(2 * QUADRANTS.fits["load_positive"].u_slope)
    expected = [QUADRANTS.load_positive.offset_nm, -QUADRANTS.load_negative.offset_nm]
    assert [side.value for side in offset.sides] == pytest.approx(expected)
    assert result.verdict == "PASS"


def test_a_torque_that_wanders_while_calibrating_is_in_the_uncertainty_of_the_lines() -> None:
    """By 0.3 % of the peak, for 0.2 s each: an unloading offset was 0.43 N·m off, and its fit said ± 0.26."""
    random = np.random.default_rng(3)
    wander = lfilter([1.0], [1.0, -(1.0 - 1.0 / 200.0)], random.normal(0.0, 1.4 * 0.1, TRACE.samples))
    wandering = dataclasses.replace(TRACE, torque_out_nm=TRACE.torque_out_nm + wander)
    fits = fit_quadrants(wandering, commanded_runs(wandering)).fits
    for name, fit in fits.items():
        assert abs(fit.offset_nm - QUADRANTS.fits[name].offset_nm) <= 2.0 * fit.u_offset_nm


def test_tight_unit_fails_on_the_offset() -> None:
    tight = bench_trace(ReferenceUnit(input_friction_nm=0.3), 453.2, cycles=1)
    wanted = [MetricWanted("torque_ratio_offset", min=-25.0)]
    result = analyse(tight, dataclasses.replace(METHOD, output_torque="reaction"), wanted)
    assert result.verdict == "FAIL"
    assert "more friction than allowed" in result.reasons[0]


def test_one_quadrant_missing_is_named() -> None:
    runs = [run for run in commanded_runs(TRACE) if run.role == "calibrate"]
    with pytest.raises(AnalysisError, match="quadrant unload_positive has 0 points"):
        fit_quadrants(TRACE, runs[:1])


def without(*missing: str) -> Trace:
    channels = {
        name: getattr(TRACE, name)
        for name in ("torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad", "segment")
        if name not in missing
    }
    return Trace(**channels, segments={} if "segment" in missing else TRACE.segments)


@pytest.mark.parametrize(
    ("missing", "said"),
    [
        (("torque_in_nm", "torque_out_nm"), "column torque_in_nm"),
        (("segment",), "no calibrate segment"),
        (("torque_out_nm",), "column torque_out_nm"),
    ],
)
def test_what_the_method_needs_and_the_trace_lacks_is_named(missing: tuple[str, ...], said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        analyse(without(*missing), METHOD, WANTED)


def test_output_torque_alone_is_taken_as_converted_before() -> None:
    result = analyse(without("torque_in_nm"), METHOD, WANTED)
    measured = analyse(TRACE, dataclasses.replace(METHOD, output_torque="reaction"), WANTED)
    expected = [metric.headline.value for metric in measured.metrics]
    assert [metric.headline.value for metric in result.metrics] == pytest.approx(expected, rel=1e-12)
    assert any("as given" in note for note in result.notes)


def test_line_that_cannot_be_inverted_is_refused() -> None:
    line = TorqueLine(0.0, 94.7)
    with pytest.raises(AnalysisError, match="unload_negative"):
        Quadrants(line, line, line, TorqueLine(0.0, np.nan))
