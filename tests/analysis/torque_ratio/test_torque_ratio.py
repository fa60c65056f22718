"""Torque ratio of an RV-40E-121 from published calibrations; figures recomputed from the printed tables."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from published import DATA

from analysis.torque_ratio.line_fit import fit_torque_ratio
from analysis.trace.errors import AnalysisError


def table(name: str) -> tuple[np.ndarray, np.ndarray]:
    torque_out, torque_in = np.loadtxt(DATA / name, delimiter=",", skiprows=1, unpack=True)
    return torque_in, torque_out


def test_22_points() -> None:
    fit = fit_torque_ratio(*table("torque_ratio_rv40e.csv"))
    assert fit.points == 22
    assert fit.offset_nm == pytest.approx(-13.889650, abs=5e-7)
    assert fit.slope == pytest.approx(94.698870, abs=5e-7)
    assert fit.residual_sd_nm == pytest.approx(8.878, abs=5e-4)
    assert fit.u_offset_nm == pytest.approx(3.845, abs=5e-4)
    assert fit.u_slope == pytest.approx(1.4158, abs=5e-5)
    assert fit.correlation == pytest.approx(-0.870, abs=5e-4)
    assert fit.r_squared == pytest.approx(0.99555, abs=5e-6)
    assert fit.theil_sen_offset_nm == pytest.approx(-13.471, abs=5e-4)
    assert fit.theil_sen_slope == pytest.approx(94.531, abs=5e-4)
    assert fit.torque_in_nm(412.0) == pytest.approx(4.4973, abs=5e-5)


def test_outlier_is_flagged_and_changes_the_line() -> None:
    torque_in, torque_out = table("torque_ratio_rv40e.csv")
    fit = fit_torque_ratio(torque_in, torque_out)
    assert fit.flagged.tolist() == [3]
    assert (torque_out[3], torque_in[3]) == (60.0, 1.113)
    assert fit.studentised[3] == pytest.approx(-6.48, abs=5e-3)
    without = fit_torque_ratio(np.delete(torque_in, 3), np.delete(torque_out, 3))
    assert without.offset_nm == pytest.approx(-9.732, abs=5e-4)
    assert without.slope == pytest.approx(93.603, abs=5e-4)
    assert not without.flagged.size


def test_6_points_and_the_printed_chord() -> None:
    torque_in, torque_out = table("torque_ratio_rv40e_6.csv")
    fit = fit_torque_ratio(torque_in, torque_out)
    assert fit.offset_nm == pytest.approx(-19.8914, abs=5e-5)
    assert fit.slope == pytest.approx(95.0558, abs=5e-5)
    chord = (torque_out[-1] - torque_out[0]) / (torque_in[-1] - torque_in[0])
    assert (chord, -chord * torque_in[0]) == (pytest.approx(94.5, abs=0.05), pytest.approx(-14.2, abs=0.05))


def test_uncertainty_of_the_line_uses_the_covariance() -> None:
    torque_in, torque_out = table("torque_ratio_rv40e.csv")
    fit = fit_torque_ratio(torque_in, torque_out)
    # at the mean input torque the line is best known: s / sqrt(n)
    assert fit.u_torque_out_nm(float(torque_in.mean())) == pytest.approx(fit.residual_sd_nm / np.sqrt(22))
    assert fit.u_torque_out_nm(0.0) == pytest.approx(fit.u_offset_nm)


@given(
    offset=st.floats(-50, 50),
    slope=st.floats(10, 300),
    count=st.integers(3, 30),
)
def test_an_exact_line_is_found(offset: float, slope: float, count: int) -> None:
    torque_in = np.linspace(0.1, 4.5, count)
    fit = fit_torque_ratio(torque_in, offset + slope * torque_in)
    assert fit.slope == pytest.approx(slope, rel=1e-9)
    assert fit.offset_nm == pytest.approx(offset, abs=1e-7)
    assert fit.theil_sen_slope == pytest.approx(slope, rel=1e-9)
    assert fit.torque_in_nm(float(fit.torque_out_nm(1.0))) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("torque_in", "torque_out", "said"),
    [
        ([1.0, 2.0], [1.0, 2.0], "3 pairs or more"),
        ([1.0, 1.0, 1.0], [1.0, 2.0, 3.0], "every input torque is 1 N·m"),
        ([1.0, 2.0, np.nan], [1.0, 2.0, 3.0], "pair 3: found nan and 3"),
    ],
)
def test_what_cannot_be_fitted_is_said(torque_in: list[float], torque_out: list[float], said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        fit_torque_ratio(np.array(torque_in), np.array(torque_out))


def test_uncertainty_of_a_target_is_that_of_the_line_over_its_slope() -> None:
    fit = fit_torque_ratio(*table("torque_ratio_rv40e.csv"))
    at = fit.torque_in_nm(412.0)
    assert fit.u_torque_in_nm(412.0) == pytest.approx(fit.u_torque_out_nm(at) / fit.slope)
    # Drawn anew with the scatter of the points, the input torque for 412 N·m scatters as it says.
    random = np.random.default_rng(5)
    again = [
        fit_torque_ratio(fit.inputs_nm, fit.torque_out_nm(fit.inputs_nm) + random.normal(0, fit.residual_sd_nm, 22))
        for _ in range(2000)
    ]
    assert np.std([one.torque_in_nm(412.0) for one in again]) == pytest.approx(fit.u_torque_in_nm(412.0), rel=0.05)
