"""Validity checks that ask whether the calibration of a run can convert the torque of its cycles."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from check_support import (
    CONVERTED,
    GOOD,
    GOOD_CONVERTED,
    GOOD_RUN,
    OF_CONVERTED,
    by_stored_lines,
    calibrated_to,
    calibrated_without,
    calibrates,
    gain_after_calibration,
    judged,
    kept,
    of,
    zero_moved_in_a_branch,
)
from reference_unit import RATIO

from analysis.evaluation.verdict import Verdict


@pytest.mark.parametrize(("peak_nm", "passes"), [(453.2, True), (444.0, False), (465.0, False)])
def test_a_calibration_to_another_peak_does_not_convert_these_cycles(peak_nm: float, passes: bool) -> None:  # noqa: FBT001
    """2 % of the peak move the spring constant by four times its uncertainty, and nothing else shows it."""
    result = judged(**calibrated_to(peak_nm))
    found = of(result, "calibrated_turn")
    assert found.passed is passes
    assert found.figure == pytest.approx(abs(100.0 * (453.2 / peak_nm - 1.0)), abs=0.2)
    assert result.verdict is (Verdict.PASS if passes else Verdict.NOT_DECIDABLE)
    assert [one.id for one in result.checks if one.passed is False] == ([] if passes else ["calibrated_turn"])


def test_a_calibration_without_samples_about_zero_does_not_find_it() -> None:
    """What lies in a gap of 10 N·m moves the width at 3 % by twelve times its uncertainty."""
    wide, narrow = (judged(**calibrated_without(torque_nm)) for torque_nm in (5.0, 1.0))
    assert wide.verdict is Verdict.NOT_DECIDABLE
    assert "no sample between -5" in of(wide, "calibrated_gap").text
    assert of(narrow, "calibrated_gap").passed is True


def test_a_zero_at_the_bound_of_its_search_was_not_found() -> None:
    off = judged(dataclasses.replace(GOOD, torque_out_nm=GOOD.torque_out_nm + 10.0), CONVERTED)
    assert of(off, "calibrated_zero").figure > 95.0
    assert "its search ended at +4." in of(off, "calibrated_zero").text
    assert of(GOOD_CONVERTED, "calibrated_zero").figure < 30.0


@pytest.mark.parametrize("check", OF_CONVERTED)
def test_where_this_run_converts_nothing_its_calibration_is_not_asked(check: str) -> None:
    for result in (GOOD_RUN, by_stored_lines(GOOD)):
        assert of(result, check).passed is None
        assert "needs an output torque that is calculated by a calibration" in of(result, check).text


@pytest.mark.parametrize("gain", [1.015, 0.985])
def test_a_gain_that_changes_after_the_calibration_is_seen(gain: float) -> None:
    """1.5 % of the output torque in the middle of a run moved the wind-up by twelve times its U, with a PASS."""
    result = judged(**gain_after_calibration(gain))
    found = of(result, "calibration_agreement")
    assert found.figure == pytest.approx(1.5, abs=0.15)
    assert result.verdict is Verdict.NOT_DECIDABLE
    assert [one.id for one in result.checks if one.passed is False] == ["calibration_agreement", "calibration_torque"]
    assert of(GOOD_RUN, "calibration_agreement").figure < 0.05
    assert of(GOOD_CONVERTED, "calibration_agreement").figure < 0.05


@pytest.mark.parametrize(("bends", "passes"), [(0.0, True), (0.07, False)])
def test_friction_that_changes_within_a_branch_of_the_calibration_is_seen(bends: float, *, passes: bool) -> None:
    """It went down by 9 N·m of the output within a branch: an offset of −12.4 N·m read −15.8 ± 0.8, with a PASS."""
    falls = calibrates(GOOD) & (GOOD.torque_out_nm < -330.0) & (np.gradient(GOOD.torque_out_nm) < 0.0)
    result = judged(dataclasses.replace(GOOD, torque_in_nm=GOOD.torque_in_nm + bends * falls))
    assert of(result, "calibration_agreement").passed is passes


@pytest.mark.parametrize(("moved_nm", "passes"), [(1.0, True), (4.0, False)])
def test_a_zero_that_moves_for_a_branch_of_the_calibration_is_seen(moved_nm: float, *, passes: bool) -> None:
    """The line of that branch is as straight as before, and its slope the same: an offset was 4 N·m off, U 0.4 N·m."""
    result = judged(**zero_moved_in_a_branch(moved_nm))
    assert of(result, "calibration_agreement").passed is True
    assert of(result, "calibration_torque").passed is passes


def test_a_zero_that_moves_within_a_branch_of_the_calibration_is_seen() -> None:
    """5.5 N·m for 3 s: an offset of −14.3 N·m read −18.2 ± 0.6, with a PASS."""
    first = int(np.flatnonzero(calibrates(GOOD) & (GOOD.torque_out_nm > 30.0))[0])
    moved = np.zeros(GOOD.samples)
    moved[first : first + round(3.0 / float(np.median(np.diff(GOOD.t_s))))] = 5.5
    found = of(judged(dataclasses.replace(GOOD, torque_out_nm=GOOD.torque_out_nm - moved)), "calibration_torque")
    assert found.passed is False
    assert "by 2.3 N·m near 113 N·m" in found.text


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_unit_with_other_friction_in_the_cycles_has_the_same_ratio(share: float) -> None:
    """Friction that is warmer, or faster: a tenth of it, 2 % of the torque under load."""
    friction_nm = GOOD.torque_in_nm - GOOD.torque_out_nm / RATIO
    other = np.where(calibrates(GOOD), GOOD.torque_in_nm, GOOD.torque_out_nm / RATIO + share * friction_nm)
    result = judged(dataclasses.replace(GOOD, torque_in_nm=other))
    assert of(result, "calibration_agreement").figure < 0.1
    assert of(result, "calibration_torque").figure < 0.05


def test_without_both_torques_or_a_calibration_they_are_not_compared() -> None:
    alone, without = (
        judged(dataclasses.replace(GOOD, torque_in_nm=None)), judged(kept(GOOD, np.flatnonzero(~calibrates(GOOD)))),
    )  # fmt: skip
    for check in ("calibration_agreement", "calibration_torque"):
        found = of(alone, check)
        assert found.passed is None
        assert "needs two torque channels" in found.text
        found = of(without, check)
        assert found.passed is None
        assert "needs a calibration in this run" in found.text
