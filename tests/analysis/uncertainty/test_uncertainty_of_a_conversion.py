"""The budget of a torque that is converted from the input torque."""

import dataclasses
import math

import numpy as np
import pytest
from budget_support import CALIBRATED, METHOD, NO_ERRORS, NO_NOISE, QUIET, TRACE, contributions, metric
from reference_unit import FIGURES

from analysis.evaluation.pipeline import analyse
from analysis.loop.measured import measure
from analysis.loop.method import MetricWanted
from analysis.torque_ratio.quadrants import Leftover, Leftovers
from analysis.uncertainty.conditions import conditions_of
from analysis.uncertainty.figures import LineCovariance, SensorFigures, TorqueFigures
from analysis.uncertainty.transfer import transfer_moves


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


def test_what_a_calibration_leaves_over_is_as_large_between_its_bins_as_in_them() -> None:
    """Zero torque lies between two bins: errors of unlike sign were averaged there, and U of the loop at zero small."""
    found = measure(TRACE, CALIBRATED)
    conditions, loop = conditions_of(found), found.loops[0]
    _, moves = transfer_moves(loop, conditions, SensorFigures())
    for side, branch, direction in ((0, loop.forward, 1), (1, loop.backward, -1)):
        left = found.quadrants.left[direction]
        corrected, fine = left.corrected, left.fine
        over = fine.error_nm - left.at(fine.place_nm)
        inside, own = (
            np.abs(values[:, None] - bins).argmin(axis=1)
            for values, bins in ((fine.place_nm, corrected.place_nm), (branch.torque_nm, corrected.torque_nm))
        )
        u = np.sqrt(sum(np.square(move[side][0]) for move in moves))
        about_zero = np.flatnonzero(np.abs(branch.torque_nm) < 10.0)
        assert about_zero.size > 2
        for point in about_zero:
            expected = np.sqrt(np.mean(np.square(over[inside == own[point]])))
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
    place = (np.arange(960) + 0.5) * 0.9 - 432.0
    error = random.normal(0.0, 0.1 / math.sqrt(16.0), 960)  # 0.1 N·m per sample, 16 samples per fine bin
    fine = Leftover(2.0 * place, place, error, np.full(960, 16.0))
    means = (values.reshape(-1, 4).mean(axis=1) for values in fine[:3])
    left = Leftovers(0.0, Leftover(*means, np.full(240, 64.0)), fine)
    noisy = dataclasses.replace(found, quadrants=dataclasses.replace(found.quadrants, left={1: left, -1: left}))
    u, _ = transfer_moves(found.loops[0], conditions_of(noisy), quiet)
    u_unknown, _ = transfer_moves(found.loops[0], conditions_of(noisy), NO_NOISE)
    assert u_unknown == pytest.approx(0.1 * math.sqrt(1.0 / 16.0 - 1.0 / 64.0), rel=0.1)
    assert 0.1 / math.sqrt(64.0) <= u < 0.85 * u_unknown
