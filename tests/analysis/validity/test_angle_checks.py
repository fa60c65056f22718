"""Validity checks that look at angles: lag, drift, slip, encoders that stand or are wrong in scale, the fixture."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from check_support import GOOD, KNOWN, METHOD, P1, WANTED, changed, judged, of, steps_in_angle
from printed_numbers import reads
from reference_unit import ARC, RATIO, bench_trace, exact_trace, timed_trace

from analysis.evaluation.pipeline import analyse
from analysis.evaluation.verdict import Verdict
from analysis.loop.fixture_curve import FixtureCurve
from analysis.loop.method import MetricWanted
from analysis.trace.trace import Trace


def test_different_lags_without_time_are_not_passed() -> None:
    lags = {"torque_out_nm": 0.05, "angle_out_rad": 0.0}
    result = analyse(exact_trace(P1, 480.0), dataclasses.replace(METHOD, lags_s=lags), WANTED)
    found = of(result, "lag")
    assert (found.passed, found.figure) == (False, None)
    assert "without a time column" in found.text


def lagging(trace: Trace, lag_s: float) -> Trace:
    """A trace whose torque comes later than its angle."""
    return dataclasses.replace(trace, torque_out_nm=np.interp(trace.t_s - lag_s, trace.t_s, trace.torque_out_nm))


def test_a_lag_that_nobody_declared_is_measured_by_two_speeds() -> None:
    wanted = {"trace": timed_trace(P1, 480.0, cycles=2, speed_arcmin_s=(0.2, 2.0)), "method": METHOD, "facts": None}
    even, late = judged(**wanted), judged(**wanted | {"trace": lagging(wanted["trace"], 0.05)})
    assert of(even, "lag").figure < 0.01
    assert of(late, "lag").passed is False
    assert "as from a delay of -50" in of(late, "lag").text
    assert late.verdict is Verdict.NOT_DECIDABLE


def test_a_lag_that_cannot_be_measured_is_said_with_what_it_would_make() -> None:
    text = of(judged(lagging(timed_trace(P1, 480.0), 0.05), METHOD, None), "lag").text
    assert "not measured: the lags of the channels are not known, and cycles at one speed cannot show lags" in text
    told = "at 0.385 arcmin/s every 10 ms of lag would change the width of the loop by 0.0077 arcmin"
    assert reads(text, told)
    assert "without a time column" in of(analyse(exact_trace(P1, 480.0), METHOD, WANTED), "lag").text


def test_the_locked_angle_may_be_replaced_by_the_fixture() -> None:
    alone = dataclasses.replace(GOOD, angle_out_rad=None)
    curve = FixtureCurve((-500.0, 500.0), (-0.05, 0.05))
    bare = dataclasses.replace(KNOWN, fixture_stiffness_nm_per_arcmin=None)
    assert of(judged(trace=alone), "locked_angle").passed
    assert of(judged(trace=alone, method=dataclasses.replace(bare, fixture_curve=curve)), "locked_angle").passed
    both = dataclasses.replace(curve, angles="both")
    assert not of(judged(trace=alone, method=dataclasses.replace(bare, fixture_curve=both)), "locked_angle").passed
    assert of(judged(method=bare), "locked_angle").passed


def test_a_loop_whose_reversals_are_missing_is_not_said_to_have_moved() -> None:
    """Branches of a report whose torque was masked after each reversal: what is missing is named, not the unit."""
    exact = exact_trace(P1, 480.0, cycles=2)
    starts = np.flatnonzero(np.diff(exact.segment, prepend=-1))
    kept = np.arange(exact.samples) - np.repeat(starts, 20_001) >= 3_000
    cut = {name: getattr(exact, name)[kept] for name in ("torque_out_nm", "angle_out_rad", "segment")}
    found = of(judged(dataclasses.replace(exact, **cut), METHOD, None), "loop_closure")
    assert found.passed is False
    assert "N·m are missing in the trace after a reversal" in found.text
    assert "has moved" not in found.text
    assert "has moved" in of(judged(**steps_in_angle()), "loop_closure").text


def test_an_encoder_of_the_locked_shaft_that_stands_is_told() -> None:
    result = judged(dataclasses.replace(GOOD, angle_out_rad=np.zeros(GOOD.samples)))
    assert of(result, "locked_compliance").figure == pytest.approx(0.0)
    assert result.verdict is Verdict.NOT_DECIDABLE


def test_where_the_fixture_hardly_gives_way_its_encoder_is_not_judged() -> None:
    """A fixture too stiff to matter, and an encoder too coarse for it: neither says anything of the encoder."""
    stiff = dataclasses.replace(KNOWN, fixture_stiffness_nm_per_arcmin=1e6)
    assert "too little to matter" in of(judged(method=stiff), "locked_compliance").text
    noise = np.random.default_rng(3).normal(0.0, 20 * ARC, GOOD.samples)
    noisy = judged(dataclasses.replace(GOOD, angle_out_rad=GOOD.angle_out_rad + noise))
    assert "too coarse" in of(noisy, "locked_compliance").text


def test_the_locked_shaft_is_held_against_its_own_side_of_the_fixture() -> None:
    """A soft coupling at the input is no motion of the locked output."""
    parts = dataclasses.replace(KNOWN, fixture_stiffness_nm_per_arcmin=2000.0, locked_stiffness_nm_per_arcmin=1e4)
    whole = dataclasses.replace(KNOWN, fixture_stiffness_nm_per_arcmin=2000.0)
    assert of(judged(method=parts), "locked_compliance").figure == pytest.approx(100.0, rel=0.02)
    assert of(judged(method=whole), "locked_compliance").passed is False


@pytest.mark.parametrize("torque_nm", [50.0, 350.0])
def test_an_angle_that_stands_while_its_shaft_is_loaded_is_told(torque_nm: float) -> None:
    """A saturated encoder: the unit reads stiffer than it is, up to no compliance at all."""
    most = float(np.abs(GOOD.angle_in_rad[np.abs(GOOD.torque_out_nm) < torque_nm]).max())
    stands = np.clip(GOOD.angle_in_rad, -most, most)
    result = judged(trace=dataclasses.replace(GOOD, angle_in_rad=stands))
    assert result.verdict is Verdict.NOT_DECIDABLE
    assert "the angle of the loaded shaft stands" in of(result, "clipping").text


def test_a_saturated_angle_with_noise_is_told() -> None:
    """One unsteady count at the end of the range must not hide it."""
    flicker = np.random.default_rng(3).integers(0, 2, GOOD.samples) * 1e-6
    most = 0.8 * float(np.abs(GOOD.angle_in_rad).max())
    stands = np.clip(GOOD.angle_in_rad, -most, most) + flicker
    result = judged(trace=dataclasses.replace(GOOD, angle_in_rad=stands))
    assert "the angle of the loaded shaft stands" in of(result, "clipping").text
    assert result.verdict is Verdict.NOT_DECIDABLE


def test_a_fixture_that_takes_the_whole_windup_is_told() -> None:
    """As soft as unit and fixture together: nothing is left for the unit, which then reads stiffer than anything."""
    soft = FixtureCurve((-500.0, 500.0), (-5.4, 5.4), "both")
    result = judged(method=dataclasses.replace(KNOWN, fixture_curve=soft))
    assert of(result, "clipping").passed is False


def test_coarse_angles_are_the_one_reason() -> None:
    """Rounded to a tenth of a radian: what else fails then, fails by it."""
    coarse = np.round(GOOD.angle_in_rad, 1)
    result = judged(trace=dataclasses.replace(GOOD, angle_in_rad=coarse, drive_angle_rad=None))
    assert [reason.split(":")[1].strip() for reason in result.reasons] == ["angle_steps"]
    assert of(result, "clipping").passed is False


def test_angles_in_milliradians_are_not_an_encoder_that_stands() -> None:
    """The lock gives way by less than they are rounded to: more digits are wanted, not another encoder."""
    rounded = {name: np.round(getattr(GOOD, name), 3) for name in ("angle_in_rad", "angle_out_rad")}
    result = judged(trace=dataclasses.replace(GOOD, drive_angle_rad=None, **rounded))
    assert result.verdict is Verdict.NOT_DECIDABLE
    for check in ("late_torque", "locked_compliance"):
        assert "with more digits" in of(result, check).text


def test_an_angle_without_any_change_is_no_measurement() -> None:
    result = judged(trace=dataclasses.replace(GOOD, angle_in_rad=np.zeros(GOOD.samples)))
    assert of(result, "clipping").figure > 40.0


@pytest.mark.parametrize("counts", [1.0, 8.0])
def test_a_coarse_encoder_is_not_a_saturated_one(counts: float) -> None:
    """A count of an eighth arcmin at the output is poor, which the uncertainty says; nothing stands still."""
    count = counts * ARC * RATIO / 64.0
    coarse = np.round(GOOD.angle_in_rad / count) * count
    assert of(judged(trace=dataclasses.replace(GOOD, angle_in_rad=coarse)), "clipping").passed


def test_a_drift_that_is_corrected_but_large_is_not_judged() -> None:
    trace = timed_trace(P1, 480.0, cycles=3)
    drifting = dataclasses.replace(trace, angle_out_rad=trace.angle_out_rad + 0.5 / 60 * trace.t_s * ARC)
    result = analyse(drifting, METHOD, WANTED)
    assert result.metrics[0].headline.value == pytest.approx(0.94, abs=5e-5)
    assert result.verdict is Verdict.NOT_DECIDABLE


@pytest.mark.parametrize(("slip_arcmin", "verdict"), [(0.0, "FAIL"), (0.1, "NOT DECIDABLE"), (-0.1, "FAIL")])
def test_a_slip_at_the_turn_that_the_gate_lets_pass_makes_no_pass(slip_arcmin: float, verdict: str) -> None:
    # 0.1 arcmin are one per cent of the wind-up, and a tenth of the backlash that is judged.
    one = bench_trace(P1, 453.2, cycles=1)
    later = max(index for index, info in one.segments.items() if info.role == "measure")
    direction = one.segments[later].direction
    slipped = dataclasses.replace(
        one, angle_in_rad=one.angle_in_rad + (one.segment == later) * direction * slip_arcmin * ARC * RATIO
    )
    honest = analyse(one, KNOWN, WANTED).metrics[0].headline.value
    assert honest is not None
    wanted = [MetricWanted("backlash_width_3pct", max=honest - 0.05)]
    found = analyse(slipped, KNOWN, wanted)
    (closure,) = [check for check in found.checks if check.id == "loop_closure"]
    assert closure.passed
    assert found.verdict.value == verdict
    assert any("Without that gap" in reason for reason in found.reasons) == (verdict == "NOT DECIDABLE")


@pytest.mark.parametrize("scale", [0.4, 0.6, 1.0, 1.7, 2.3])
def test_a_wrong_scale_of_the_angle_is_seen_where_no_unit_is_like_it(scale: float) -> None:
    checks = judged(**changed(angle_in_rad=scale * GOOD.angle_in_rad))
    found = {name: of(checks, name) for name in ("stiffness_low", "stiffness_high")}
    failed = [name for name, check in found.items() if check.passed is False]
    assert failed == (["stiffness_low"] if scale > 2.0 else ["stiffness_high"] if scale < 1.0 / 1.5 else [])
    assert all("and the recipe declares 100 for this unit" in found[name].text for name in failed)


def test_without_a_declared_stiffness_its_gate_says_so() -> None:
    checks = judged(method=dataclasses.replace(KNOWN, catalogue_stiffness_nm_per_arcmin=None))
    for name in ("stiffness_low", "stiffness_high"):
        found = of(checks, name)
        assert (found.passed, found.figure) == (None, None)
        assert "needs the stiffness of the unit" in found.text


def test_a_windup_that_does_not_change_is_told_in_plain_words() -> None:
    still = changed(angle_in_rad=np.zeros(GOOD.samples), angle_out_rad=np.zeros(GOOD.samples))
    failed = {check.id: check.text for check in judged(**still).checks if check.passed is False}
    for check in ("wrong_way", "loop_closure", "loss"):
        assert "the wind-up does not change" in failed[check]
    assert not any("e+" in text for text in failed.values())
