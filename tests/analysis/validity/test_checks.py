"""Validity checks: each one fails for what it is there for, and passes a good run; a failed one decides nothing."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from check_support import (
    BAD,
    FACTS,
    GOOD,
    GOOD_CONVERTED,
    GOOD_RUN,
    KNOWN,
    METHOD,
    OF_CONVERTED,
    P1,
    WANTED,
    by_stored_lines,
    changed,
    copied_cycle,
    each_row,
    judged,
    of,
    rising_cycles_off,
)
from reference_unit import bench_trace, exact_trace

from analysis.evaluation.pipeline import analyse
from analysis.evaluation.verdict import Verdict
from analysis.trace.errors import AnalysisError
from analysis.trace.trace import CHANNELS
from analysis.validity.evidence import Evidence
from analysis.validity.judge import FIGURES, TABLES, check_reasons, judge_checks
from definitions.checks import CHECKS


def test_every_check_has_its_figure_and_every_figure_its_check() -> None:
    assert set(FIGURES) == set(CHECKS)
    assert sum(len(table.FIGURES) for table in TABLES) == len(CHECKS)


def test_every_gate_has_something_that_makes_it_fail() -> None:
    assert set(BAD) == set(CHECKS)
    assert [check.id for check in GOOD_RUN.checks] == list(CHECKS)


@pytest.mark.parametrize("check", CHECKS)
def test_a_good_run_passes(check: str) -> None:
    run = GOOD_CONVERTED if check in OF_CONVERTED else GOOD_RUN
    found = of(run, check)
    assert found.passed is True, found
    assert found.figure is not None
    assert f"{found.limit:.3g}" in found.text
    assert (run.verdict, run.reasons) == (Verdict.PASS, ())


@pytest.mark.parametrize("check", CHECKS)
def test_a_failed_gate_decides_nothing_and_says_why(check: str) -> None:
    result = judged(**BAD[check]())
    found = of(result, check)
    assert found.passed is False, found
    assert result.verdict is Verdict.NOT_DECIDABLE
    assert result.metrics[0].verdict is Verdict.NOT_DECIDABLE
    if check == "record":
        assert result.reasons[0] == "measurement invalid: 200 records were lost"
        return
    (reason,) = [text for text in result.reasons if text.startswith(f"measurement invalid: {check}: ")]
    assert found.text in reason
    assert CHECKS[check].action in reason
    assert f"{found.figure:.3g}" in reason
    assert f"{found.limit:.3g}" in reason


@pytest.mark.parametrize("check", CHECKS)
def test_what_could_not_be_evaluated_is_not_applicable(check: str) -> None:
    (found,) = [one for one in judge_checks(Evidence(None)) if one.id == check]
    if check == "record":
        assert found.passed is True
    else:
        assert (found.passed, found.figure) == (None, None)
        assert "not applicable" in found.text


def test_facts_of_a_run_that_could_not_be_evaluated_still_speak() -> None:
    checks = judge_checks(Evidence(None, dataclasses.replace(FACTS, missed=400, not_ready=3), ("lost",)))
    reasons = check_reasons(checks, ("lost",))
    assert reasons[0] == "measurement invalid: lost"
    assert any("400 of 100000 scan periods were missed (0.400%)" in reason for reason in reasons)
    assert any("not ready: 3 samples" in reason for reason in reasons)
    assert len(reasons) == 3


def test_of_a_bench_that_waits_periods_are_judged_where_some_were_missed_all_the_same():
    waited = dataclasses.replace(FACTS, bench_waited=1)

    def judged(missed: int) -> bool | None:
        checks = judge_checks(Evidence(None, dataclasses.replace(waited, missed=missed), ()))
        return next(check.passed for check in checks if check.id == "missed_periods")

    assert [judged(missed) for missed in (0, 3, 400)] == [None, True, False]


def test_gates_that_do_not_apply_say_why_and_decide_nothing() -> None:
    result = analyse(exact_trace(P1, 480.0), METHOD, WANTED)
    assert result.verdict is Verdict.PASS
    why = {one.id: one.text for one in result.checks if one.passed is None}
    assert set(why) == {
        "missed_periods", "sample_age", "torque_in_saturated", "torque_out_saturated", "not_ready", "torque_zeroes",
        "drift", "repeat",
        "copied_cycles", "repeated_samples", "lag", "noise_low", "noise_high", "time_scale", "ramp_rate",
        "torque_agreement", "efficiency_low", "efficiency_high", "ratio_agreement",
        "temperature_change", "temperature_low", "temperature_high", "locked_motion", "torque_lines", "torque_bend",
        "torque_out_zero", "calibrated_turn", "calibrated_gap", "calibrated_zero", "drive_torque_agreement",
        "drive_torque_gap", "drive_angle_agreement", "drive_angle_direction", "drive_angle_repeat",
        "locked_compliance", "stiffness_low", "calibration_agreement", "calibration_torque",
        "creep_back",
    }  # fmt: skip
    assert "two cycles" in why["drift"]
    assert "needs a trace with a time column" in why["ramp_rate"]
    assert "two torque channels" in why["torque_agreement"]
    assert "not measured: needs two torque channels" in why["ratio_agreement"]


def test_limits_can_be_set_where_they_can() -> None:
    strict = dataclasses.replace(KNOWN, check_limits={"repeat": 1e-6, "points_per_bin": 1e6})
    result = judged(method=strict)
    assert [check.id for check in result.checks if check.passed is False] == ["points_per_bin", "repeat"]
    lax = dataclasses.replace(KNOWN, check_limits={"drift": 20.0})
    assert judged(**BAD["drift"]() | {"method": lax}).verdict is Verdict.PASS
    for name in ("wrong_way", "no_such_gate", "missed_periods"):
        with pytest.raises(AnalysisError, match=name):
            judged(method=dataclasses.replace(KNOWN, check_limits={name: 1.0}))


def test_a_limit_wider_than_usual_is_told_in_the_gate() -> None:
    loose = dataclasses.replace(KNOWN, check_limits={"drift": 100.0, "points_per_bin": 1.0, "repeat": 1.0})
    texts = {check.id: check.text for check in judged(method=loose).checks}
    assert "at most by the recipe, where 1 % is usual" in texts["drift"]
    assert "at least by the recipe, where 3 samples is usual" in texts["points_per_bin"]
    assert not any("usual" in text for name, text in texts.items() if name not in ("drift", "points_per_bin"))


def test_gates_are_plain_data() -> None:
    plain = json.loads(json.dumps(GOOD_RUN.to_dict()["gates"], allow_nan=False))
    assert [set(one) for one in plain] == [{"id", "figure", "limit", "unit", "passed", "text"}] * len(CHECKS)


@pytest.mark.parametrize("hidden_nm", [0.0, 4.0])
def test_a_display_that_shows_little_torque_as_none_is_seen(hidden_nm: float) -> None:
    shown = np.sign(GOOD.torque_out_nm) * np.maximum(np.abs(GOOD.torque_out_nm) - hidden_nm, 0.0)
    assert of(judged(**changed(torque_out_nm=shown)), "noise_low").passed is (hidden_nm == 0.0)


def test_rows_written_several_times_are_no_measurements() -> None:
    """Twenty of each make the uncertainty smaller; a few held samples do not matter."""
    twenty = judged(**each_row(20))
    assert twenty.metrics[0].headline.uncertainty < GOOD_RUN.metrics[0].headline.uncertainty
    assert [one.id for one in twenty.checks if one.passed is False] == ["repeated_samples", "noise_low"]
    found = of(twenty, "repeated_samples")
    assert (found.figure, twenty.verdict) == (pytest.approx(95.0, abs=0.1), Verdict.NOT_DECIDABLE)
    assert "cycle 1, rising branch" in found.text
    assert of(GOOD_RUN, "repeated_samples").figure < 0.1
    again = each_row(20)["trace"]
    own_times = dataclasses.replace(again, t_s=np.arange(again.samples) * 5e-5)
    assert of(judged(own_times), "repeated_samples").passed is False
    unknown = analyse(own_times, KNOWN, WANTED, facts=FACTS)
    assert of(unknown, "repeated_samples").passed is None


def test_a_bad_unit_still_fails() -> None:
    worn = dataclasses.replace(P1, f_c=2 * P1.f_c, j=0.6)
    result = analyse(bench_trace(worn, 453.2, cycles=3), KNOWN, WANTED, facts=FACTS)
    assert result.verdict is Verdict.FAIL


@pytest.mark.parametrize("missing", [(), ("torque_out_nm", "drive_torque_nm")])
def test_where_the_torque_is_masked_a_loop_that_does_not_close_is_seen(missing: tuple[str, ...]) -> None:
    """With and without the torque as measured at the output; a lock that stands passes the checks that look at it."""
    without = dict.fromkeys(missing)
    good, slipped = (by_stored_lines(dataclasses.replace(rising_cycles_off(off), **without)) for off in (0.0, 0.3))
    assert any("masked" in note and "masked, 0" not in note for note in good.notes)
    assert [one for one in good.checks if one.passed is False] == []
    assert all(of(good, check).passed for check in ("loop_closure", "locked_motion", "locked_compliance", "clipping"))
    assert of(good, "loop_closure").figure < 0.5
    assert slipped.metrics[0].headline.value < good.metrics[0].headline.value - 0.2
    assert of(slipped, "loop_closure").passed is False
    assert slipped.verdict is Verdict.NOT_DECIDABLE


def test_noise_of_the_input_torque_while_it_is_calibrated_is_told() -> None:
    calibrating = [number for number, one in GOOD.segments.items() if one.role == "calibrate"]
    noise = np.random.default_rng(4).normal(0.0, 0.05, GOOD.samples) * np.isin(GOOD.segment, calibrating)
    found = judged(**changed(torque_in_nm=GOOD.torque_in_nm + noise))
    assert of(found, "noise_high").passed is False
    assert of(judged(), "noise_high").passed is True


def test_a_copied_cycle_is_told_by_its_number_and_only_where_noise_is_declared() -> None:
    found = of(judged(**copied_cycle()), "copied_cycles")
    assert (found.figure, found.limit) == (pytest.approx(100.0, abs=1.0), 50.0)
    assert "cycles 1 and 2 are copies" in found.text
    assert of(judged(**copied_cycle(after=5_000)), "copied_cycles").figure > 50.0
    assert of(GOOD_RUN, "copied_cycles").figure < 1.0
    unknown = analyse(copied_cycle()["trace"], KNOWN, WANTED, facts=FACTS)
    assert of(unknown, "copied_cycles").passed is None


def test_one_delay_of_a_slow_amplifier_is_no_delay_within_a_ramp() -> None:
    """An amplifier that answers after 10 ms gives a sample each 10 ms, by which time the drive has gone on."""
    rows = np.arange(0, GOOD.samples, max(round(0.01 / float(np.median(np.diff(GOOD.t_s)))), 1))
    names = (*CHANNELS, "segment")
    sparse = dataclasses.replace(GOOD, **{name: _rows(name, rows) for name in names})
    plain = of(judged(trace=sparse), "drive_angle_direction")
    ahead = np.interp(sparse.t_s + 0.01, GOOD.t_s, GOOD.drive_angle_rad)
    found = of(judged(trace=dataclasses.replace(sparse, drive_angle_rad=ahead)), "drive_angle_direction")
    assert plain.passed
    assert found.passed
    assert found.figure < plain.figure + 0.05


def _rows(name: str, rows: np.ndarray) -> np.ndarray | None:
    values = getattr(GOOD, name)
    return None if values is None else values[rows]
