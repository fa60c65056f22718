"""The stages of the pipeline: what each corrects on closed-form loops, what it leaves alone, and what it says."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from reference_unit import ARC, RATIO, ReferenceUnit, bench_trace, exact_trace, timed_trace
from scipy import signal

from analysis.evaluation.pipeline import Result, analyse
from analysis.loop.alignment import skew_from_speeds
from analysis.loop.fixture_curve import FixtureCurve, compensated_stiffness, series_stiffness
from analysis.loop.measured import measure
from analysis.loop.method import Method, MetricWanted
from analysis.loop.stages import STAGES
from analysis.loop.windup import blank_curve
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import Trace

METHOD = Method(ratio=RATIO, rated_torque_nm=412)
P1 = ReferenceUnit()
BACKLASH = MetricWanted("backlash_width_3pct")
SPRING = MetricWanted("spring_constant")
LAGS = {"torque_out_nm": 0.001, "torque_in_nm": 0.001, "angle_in_rad": 0.001, "angle_out_rad": 0.001}


def value(result: Result, index: int = 0) -> float:
    found = result.metrics[index].headline.value
    assert found is not None, result.metrics[index].reasons
    return found


def stage(result: Result, name: str):
    (found,) = [one for one in result.stages if one.name == name]
    return found


def drifting(trace: Trace, arcmin_per_min: float) -> Trace:
    return dataclasses.replace(trace, angle_out_rad=trace.angle_out_rad + arcmin_per_min / 60 * trace.t_s * ARC)


def lagging(trace: Trace, lag_s: float) -> Trace:
    """Torque behind a first-order lag."""
    keep = math.exp(-1e-3 / lag_s)
    torque = trace.torque_out_nm
    late, _ = signal.lfilter([1 - keep], [1, -keep], torque, zi=[torque[0] * keep])
    return dataclasses.replace(trace, torque_out_nm=late)


def test_every_stage_leaves_a_record_in_order() -> None:
    result = analyse(bench_trace(P1, 480.0, cycles=1), METHOD, [BACKLASH])
    assert [one.name for one in result.stages] == list(STAGES)
    plain = json.loads(json.dumps(result.to_dict()["stages"]))
    assert [one["stage"] for one in plain] == list(STAGES)
    for one in plain:
        assert one["text"]
        assert all(set(figure) == {"value", "unit"} and figure["unit"] for figure in one["figures"].values())


# Check value 7: width between the crossings of +3 %, 28.08 s apart.
@pytest.mark.parametrize(("arcmin_per_min", "reads"), [(0.05, 0.9166), (0.5, 0.706)])
def test_drift_narrows_the_loop_and_is_taken_out(arcmin_per_min: float, reads: float) -> None:
    trace = drifting(timed_trace(P1, 480.0, cycles=3, dwell_s=1.19), arcmin_per_min)
    raw = analyse(trace, dataclasses.replace(METHOD, drift="report"), [BACKLASH])
    corrected = analyse(trace, METHOD, [BACKLASH])
    assert raw.metrics[0].sides[0].value == pytest.approx(reads, abs=1e-4)
    assert [side.value for side in corrected.metrics[0].sides] == pytest.approx([0.94, 0.94], abs=5e-5)
    record = stage(corrected, "drift")
    assert record.applied
    assert record.figures["drift"].value == pytest.approx(arcmin_per_min, rel=1e-6)
    assert record.figures["drift"].unit == "arcmin/min"


def test_drift_is_not_corrected_where_there_is_none() -> None:
    wanted = [BACKLASH, SPRING]
    for seed in range(4):
        trace = bench_trace(P1, 453.2, cycles=3, seed=seed)
        left = analyse(trace, dataclasses.replace(METHOD, drift="report"), wanted)
        done = analyse(trace, METHOD, wanted)
        record = stage(done, "drift")
        assert abs(record.figures["drift"].value) < 4 * record.figures["standard error"].value
        assert record.figures["standard error"].value < 2e-3
        if not record.applied:
            assert [value(done, i) for i in (0, 1)] == [value(left, i) for i in (0, 1)]


def test_drift_is_seen_through_noise_with_an_honest_error() -> None:
    trace = drifting(bench_trace(P1, 453.2, cycles=3), 0.05)
    found = stage(analyse(trace, dataclasses.replace(METHOD, loading="output"), [BACKLASH]), "drift").figures
    assert found["drift"].value == pytest.approx(0.05, abs=4 * found["standard error"].value)
    assert 0 < found["standard error"].value < 2e-3


def test_one_cycle_shows_no_drift_and_a_trace_without_time_is_not_corrected() -> None:
    alone = analyse(timed_trace(P1, 480.0, cycles=1), METHOD, [BACKLASH])
    assert "two cycles" in stage(alone, "drift").text
    timeless = dataclasses.replace(drifting(timed_trace(P1, 480.0), 0.5), t_s=None)
    record = stage(analyse(timeless, METHOD, [BACKLASH]), "drift")
    assert not record.applied
    assert record.figures["drift"].unit == "arcmin/cycle"
    assert "no time" in record.text


# Check value 7: all three readings are those of a wind-up that turns at 0.385 arcmin/s where the width is read.
@pytest.mark.parametrize(("lag_s", "reads", "digits"), [(0.01, 0.9327, 2e-4), (0.05, 0.9020, 4e-4), (0.2, 0.786, 3e-3)])
def test_a_torque_that_lags_narrows_the_loop_and_is_moved_back(lag_s: float, reads: float, digits: float) -> None:
    trace = lagging(timed_trace(P1, 480.0), lag_s)
    known = dataclasses.replace(METHOD, lags_s={"torque_out_nm": lag_s, "angle_out_rad": 0.0})
    raw = analyse(trace, dataclasses.replace(known, alignment="report"), [BACKLASH])
    corrected = analyse(trace, known, [BACKLASH])
    assert value(raw) == pytest.approx(reads, abs=digits)
    assert value(corrected) == pytest.approx(0.94, abs=1.5e-3)
    assert stage(corrected, "time alignment").applied
    assert stage(corrected, "time alignment").figures["angle behind torque"].value == pytest.approx(-lag_s)


def test_a_pure_delay_is_corrected_exactly() -> None:
    trace = timed_trace(P1, 480.0)
    late = dataclasses.replace(trace, torque_out_nm=np.interp(trace.t_s - 0.05, trace.t_s, trace.torque_out_nm))
    known = dataclasses.replace(METHOD, lags_s={"torque_out_nm": 0.051, "angle_out_rad": 0.001})
    assert value(analyse(late, known, [BACKLASH])) == pytest.approx(0.94, abs=5e-5)


def test_values_whose_age_the_trace_knows_are_moved_by_it_one_by_one() -> None:
    """The angle is measured 4 ms before each sample, at times 12 ms: no lag of the channel can put that right."""
    trace = timed_trace(P1, 480.0)
    delays = np.where(np.arange(trace.samples) % 7 == 0, 0.012, 0.004)
    angle = np.interp(trace.t_s - 0.01 - delays, trace.t_s, trace.angle_out_rad)
    late = dataclasses.replace(trace, angle_out_rad=angle, delays_s={"angle_out_rad": delays})
    known = dataclasses.replace(METHOD, lags_s={"torque_out_nm": 0.0, "angle_out_rad": 0.01})
    found = analyse(late, known, [BACKLASH])
    assert value(found) == pytest.approx(0.94, abs=5e-5)
    assert stage(found, "time alignment").figures["lag of angle_out_rad"].value == pytest.approx(0.014)
    assert value(analyse(dataclasses.replace(late, delays_s={}), known, [BACKLASH])) > 0.942
    with pytest.raises(AnalysisError, match="delay of angle_out_rad has 3"):
        dataclasses.replace(late, delays_s={"angle_out_rad": delays[:3]})


def test_equal_lags_and_unknown_lags_move_nothing() -> None:
    trace = bench_trace(P1, 453.2, cycles=1)
    plain = analyse(trace, METHOD, [BACKLASH, SPRING])
    alike = analyse(trace, dataclasses.replace(METHOD, lags_s=LAGS), [BACKLASH, SPRING])
    assert [value(alike, i) for i in (0, 1)] == [value(plain, i) for i in (0, 1)]
    assert not stage(alike, "time alignment").applied
    assert "no correction needed" in stage(alike, "time alignment").text
    assert "not known" in stage(plain, "time alignment").text


def test_the_skew_is_estimated_from_two_speeds() -> None:
    trace = timed_trace(P1, 480.0, cycles=4, speed_arcmin_s=(0.2, 0.4, 0.2, 0.4))
    late = lagging(trace, 0.05)
    result = analyse(late, dataclasses.replace(METHOD, alignment="two_speeds"), [BACKLASH])
    figures = stage(result, "time alignment").figures
    assert figures["angle behind torque"].value == pytest.approx(-0.05, rel=0.03)
    assert figures["width at standstill"].value == pytest.approx(0.94, abs=1e-3)
    assert result.metrics[0].headline.per_cycle == pytest.approx([0.94] * 4, abs=1e-3)
    declared = dataclasses.replace(METHOD, alignment="two_speeds", lags_s={"torque_out_nm": 0.02, "angle_out_rad": 0.0})
    assert value(analyse(late, declared, [BACKLASH])) == pytest.approx(value(result), abs=1e-9)
    with pytest.raises(AnalysisError, match="two speeds"):
        analyse(timed_trace(P1, 480.0), dataclasses.replace(METHOD, alignment="two_speeds"), [BACKLASH])


def test_skew_from_speeds_is_half_the_slope() -> None:
    found = skew_from_speeds([0.1, 0.2, 0.4], [0.94 - 2 * 0.1 * 0.03, 0.94 - 2 * 0.2 * 0.03, 0.94 - 2 * 0.4 * 0.03])
    assert (found.skew_s, found.width_arcmin) == (pytest.approx(-0.03), pytest.approx(0.94))
    assert found.standard_error_s == pytest.approx(0.0, abs=1e-9)
    assert skew_from_speeds([0.1, 0.2], [0.94, 0.93]).standard_error_s is None


def on_fixture(exact: Trace, deflection: np.ndarray) -> Trace:
    """The same loop on a bench whose output encoder is missing: the fixture's deflection is in the input angle."""
    angle_in = (exact.angle_out_rad + deflection * ARC) * RATIO
    return dataclasses.replace(exact, angle_in_rad=angle_in, angle_out_rad=None)


# Check value 6.
@pytest.mark.parametrize(("stiffness", "reads"), [(5000.0, 112.58), (2000.0, 108.90), (500.0, 93.61)])
def test_a_blank_test_takes_the_fixture_out(stiffness: float, reads: float) -> None:
    exact = exact_trace(P1, 480.0)
    trace = on_fixture(exact, exact.torque_out_nm / stiffness)
    torque = np.concatenate((np.linspace(-500, 500, 2001), np.linspace(500, -500, 2001)))
    nothing = Trace(torque_out_nm=torque, angle_out_rad=np.zeros(torque.size))
    dummy = dataclasses.replace(on_fixture(nothing, torque / stiffness))
    found = measure(dataclasses.replace(dummy, segment=None, segments={}), METHOD)
    curve = blank_curve(found.loops, found.angles, "blank-1")
    raw = analyse(trace, METHOD, [SPRING, BACKLASH])
    corrected = analyse(trace, dataclasses.replace(METHOD, fixture_curve=curve), [SPRING, BACKLASH])
    assert value(raw) == pytest.approx(reads, abs=5e-3)
    assert value(corrected) == pytest.approx(115.170, abs=5e-4)
    assert value(raw, 1) == pytest.approx(value(corrected, 1), abs=1e-9) == pytest.approx(0.94, abs=5e-5)
    record = stage(corrected, "fixture")
    assert record.applied
    assert "blank-1" in record.text
    assert record.figures["stiffness at +480 N·m"].value == pytest.approx(stiffness, rel=1e-6)
    # in series at the spring constant: 1/K_r = 1/K + 1/K_1
    assert series_stiffness(115.170, stiffness) == pytest.approx(value(raw), rel=1e-4)
    assert compensated_stiffness(value(raw), stiffness, math.inf, RATIO) == pytest.approx(115.170, rel=1e-4)


def test_a_fixture_that_is_soft_around_zero_is_taken_out_pointwise() -> None:
    """One stiffness could not: lost motion would keep the play of the fixture."""
    exact = exact_trace(P1, 480.0)
    curve = FixtureCurve((-500.0, -5.0, 0.0, 5.0, 500.0), (-0.35, -0.1, 0.0, 0.1, 0.35))
    trace = on_fixture(exact, curve.at(exact.torque_out_nm))
    wanted = [MetricWanted("lost_motion"), SPRING]
    corrected = analyse(trace, dataclasses.replace(METHOD, fixture_curve=curve), wanted)
    one_value = analyse(trace, dataclasses.replace(METHOD, fixture_stiffness_nm_per_arcmin=500 / 0.35), wanted)
    assert value(corrected) == pytest.approx(0.3756, abs=5e-5)
    assert value(corrected, 1) == pytest.approx(115.170, abs=5e-4)
    assert value(one_value) > 0.5


def test_the_blank_curve_is_monotone_through_noise_and_zero_at_zero() -> None:
    random = np.random.default_rng(3)
    torque = np.concatenate((np.linspace(-480, 480, 20_001), np.linspace(480, -480, 20_001)))
    angle = (torque / 5000.0 + 0.002 + random.normal(0, 0.002, torque.size)) * ARC * RATIO
    found = measure(Trace(torque_out_nm=torque, angle_in_rad=angle), METHOD)
    curve = blank_curve(found.loops, found.angles)
    assert (np.diff(curve.deflection_arcmin) >= 0).all()
    assert curve.at(np.array([0.0]))[0] == pytest.approx(0.0, abs=1e-12)
    assert curve.stiffness_at(400.0) == pytest.approx(5000.0, rel=0.02)


def test_a_curve_corrects_only_a_wind_up_of_the_same_angles() -> None:
    trace = bench_trace(P1, 453.2, cycles=1)
    curve = FixtureCurve((-500.0, 500.0), (-0.1, 0.1), angles="loaded")
    same = dataclasses.replace(curve, angles="both")
    plain, other, own = (
        analyse(trace, dataclasses.replace(METHOD, fixture_curve=one), [SPRING]) for one in (None, curve, same)
    )
    assert value(other) == value(plain)
    assert not stage(other, "fixture").applied
    assert value(own) > value(plain)


@pytest.mark.parametrize(
    ("torque", "deflection"),
    [
        ((0.0,), (0.0,)),
        ((0.0, 1.0), (0.0,)),
        ((1.0, 0.0), (0.0, 1.0)),
        ((0.0, 1.0), (1.0, 0.0)),
        ((0.0, 1.0), (0.0, math.nan)),
    ],
)
def test_a_fixture_curve_that_is_none_is_refused(torque: tuple[float, ...], deflection: tuple[float, ...]) -> None:
    with pytest.raises(AnalysisError, match="fixture curve"):
        FixtureCurve(torque, deflection)


@pytest.mark.parametrize("change", [{"alignment": "none"}, {"drift": "no"}, {"fixture": ""}, {"lags_s": {"t": -1.0}}])
def test_a_method_refuses_what_it_does_not_know(change: dict) -> None:
    with pytest.raises(AnalysisError, match="method"):
        dataclasses.replace(METHOD, **change)
