"""What a run's checks leave open: a figure for each, and a larger error is refused."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from check_support import ARC, GOOD, GOOD_RUN, both_torques, changed, judged, late_within, of, repeating

from analysis.evaluation.pipeline import Result
from analysis.loop.measured import measure
from analysis.validity import loop_checks
from definitions.checks import CHECKS

OPEN = {name: check.leaves_open for name, check in CHECKS.items() if check.leaves_open is not None}


def left(result: Result, check: str) -> float:
    found = of(result, check).left_open
    assert found is not None
    assert found.figure is not None
    return found.figure


def test_every_check_that_leaves_an_error_open_says_its_size() -> None:
    told = json.loads(json.dumps(GOOD_RUN.to_dict()["not_excluded"], allow_nan=False))
    assert [one["id"] for one in told] == list(OPEN)
    for one in told:
        assert one["unit"] == OPEN[one["id"]].unit
        assert one["figure"] > 0.0
        assert one["in_budget"] is False
    assert all(check.left_open is None for check in GOOD_RUN.checks if check.id not in OPEN)


def test_what_was_not_checked_has_no_size() -> None:
    alone = dataclasses.replace(GOOD, torque_in_nm=None, drive_angle_rad=None)
    sizes = {one["id"]: one["figure"] for one in judged(alone).to_dict()["not_excluded"]}
    assert [name for name, size in sizes.items() if size is None] == [
        "ratio_agreement", "torque_out_zero", "torque_bend", "drive_torque_agreement", "drive_torque_gap",
        "drive_angle_agreement", "drive_angle_direction",
    ]  # fmt: skip


@pytest.mark.parametrize("sign", [1, -1])
def test_a_gain_is_within_what_is_left_open_or_refused(sign: int) -> None:
    for percent, passed in ((0.5, True), (3.0, False)):
        gain = 1.0 + sign * percent / 100.0
        result = judged(**changed(torque_out_nm=gain * GOOD.torque_out_nm))
        assert of(result, "ratio_agreement").passed is passed
        assert left(result, "ratio_agreement") > percent


def test_a_wave_and_a_scale_beyond_what_is_left_open_are_refused() -> None:
    fast = of(GOOD_RUN, "angle_waves").left_open
    per_turn = float(fast.text.split(", ")[-1].split()[0])
    slow = left(GOOD_RUN, "drive_angle_agreement")
    for check, size, lines in (("angle_waves", fast.figure, 1.1 * per_turn), ("drive_angle_agreement", slow, 30.0)):
        waved = repeating(GOOD.angle_in_rad, 1.3 * size * ARC, lines)
        assert of(judged(**changed(angle_in_rad=waved)), check).passed is False
    way = float(np.ptp(GOOD.angle_in_rad))
    for sign in (1.0, -1.0):  # the coupling twists by as much as half of it
        scaled = GOOD.angle_in_rad * (1.0 + sign * 4.0 * slow * ARC / way)
        assert of(judged(**changed(angle_in_rad=scaled)), "drive_angle_agreement").passed is False


def test_of_waves_from_two_on_an_even_curve_leaves_three_quarters_in_any_phase() -> None:
    at = (np.arange(loop_checks.WAVE_BLOCKS) + 0.5) / loop_checks.WAVE_BLOCKS
    for waves in (loop_checks.OPEN_FROM, 3.1, 7.0, 11.9):
        for phase in np.linspace(0.0, np.pi, 8, endpoint=False):
            wave = np.cos(2.0 * np.pi * waves * at + phase)
            seen = max(
                amplitude
                for degree, some in loop_checks.EVEN.items()
                for amplitude in loop_checks._amplitudes_arcmin(
                    [(at, wave - np.polyval(np.polyfit(at, wave, degree), at))], 1.0 / some
                )
            )
            assert seen >= loop_checks.LEFT_OF_WAVE


def test_hysteresis_of_the_sensor_beyond_what_is_left_open_is_refused() -> None:
    size = left(GOOD_RUN, "torque_bend")
    found = measure(GOOD, judged.__defaults__[1])
    peak = max(float(np.abs(one.torque_nm).max()) for pair in found.pairs for one in pair)
    rising = np.zeros(GOOD.samples)
    for run in found.runs:
        for rows in run.pieces:
            rising[rows] = run.direction
    lens = -rising * (1.0 - np.square(GOOD.torque_out_nm / peak))
    assert of(judged(**changed(torque_out_nm=GOOD.torque_out_nm + 1.5 * size * lens)), "torque_bend").passed is False


def test_a_gain_of_both_torques_and_delays_within_the_ramps_are_within_what_is_left_open_or_refused() -> None:
    for gain, passed in ((1.05, True), (1.12, False)):
        assert of(judged(**both_torques(gain=gain)), "drive_torque_agreement").passed is passed
    assert left(GOOD_RUN, "drive_torque_agreement") < 12.0
    peak = float(np.abs(GOOD.torque_out_nm).max())
    lens = np.zeros(GOOD.samples)
    for run in measure(GOOD, judged.__defaults__[1]).runs:
        for rows in run.pieces:
            lens[rows] = -run.direction * (1.0 - np.square(GOOD.torque_out_nm[rows] / peak))
    size = left(GOOD_RUN, "drive_torque_gap")
    ratio = float(np.abs(GOOD.torque_in_nm).max()) / peak
    for share, passed in ((0.5, True), (1.5, False)):
        bent = changed(
            torque_out_nm=GOOD.torque_out_nm + share * size * lens,
            torque_in_nm=GOOD.torque_in_nm + share * size * ratio * lens,
        )
        assert of(judged(**bent), "drive_torque_gap").passed is passed
    # What a delay of the angle adds to the width is within what is left open, or it is refused.
    for lag_s, seen in ((0.004, False), (0.1, True)):
        result = judged(**changed(angle_in_rad=late_within(lag_s)))
        wider = abs(result.metrics[0].headline.value - GOOD_RUN.metrics[0].headline.value) / 2.0
        passed = of(result, "drive_angle_direction").passed
        assert passed is not seen
        assert seen or wider < left(GOOD_RUN, "drive_angle_direction")
