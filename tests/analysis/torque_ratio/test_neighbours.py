"""Residuals whose neighbours err alike, against what is known of them in closed form."""

import numpy as np
import pytest

from analysis.torque_ratio.line_fit import fit_torque_ratio
from analysis.torque_ratio.neighbours import alike
from analysis.trace.units import FloatArray


def autoregressive(share: float, count: int, seed: int) -> FloatArray:
    """Values each of which keeps a share of the one before it."""
    random = np.random.default_rng(seed)
    values = random.standard_normal(count)
    for index in range(1, count):
        values[index] += share * values[index - 1]
    return values - values.mean()


@pytest.mark.parametrize("share", [0.0, 0.4, 0.8])
def test_neighbours_that_err_alike_are_worth_fewer(share: float) -> None:
    """The variance of a mean grows by (1 + ρ)/(1 - ρ)."""
    found = [alike(autoregressive(share, 600, seed)) for seed in range(60)]
    assert np.mean(found) == pytest.approx((1.0 + share) / (1.0 - share), rel=0.15)


def test_it_makes_nothing_surer() -> None:
    """Neighbours that err oppositely, and none at all, count as each its own."""
    assert alike(autoregressive(-0.6, 400, 1)) == 1.0
    assert alike(np.array([])) == alike(np.array([0.5])) == alike(np.zeros(40)) == 1.0


@pytest.mark.parametrize("share", [0.0, 0.7])
def test_it_says_how_far_a_bend_scatters(share: float) -> None:
    """Of a parabola through 80 points, as many as a rough run has."""
    x = np.linspace(-0.5, 0.5, 80)
    bends, variances = [], []
    for seed in range(300):
        y = autoregressive(share, 80, seed)
        coefficients, covariance = np.polyfit(x, y, 2, cov=True)
        bends.append(coefficients[0])
        variances.append(alike(y - np.polyval(coefficients, x)) * covariance[0, 0])
    assert np.sqrt(np.mean(variances)) == pytest.approx(np.std(bends), rel=0.2)


def test_a_line_through_neighbours_that_err_alike_is_known_less_well() -> None:
    """A torque that wanders: taken for independent, 200 points said a third of what the offset scatters by."""
    torque_in = np.linspace(0.3, 4.8, 200)
    fits = [fit_torque_ratio(torque_in, 94.7 * torque_in + autoregressive(0.8, 200, seed)) for seed in range(200)]
    scatter = np.std([fit.offset_nm for fit in fits])
    assert np.mean([fit.u_offset_nm for fit in fits]) < 0.45 * scatter
    branches = [fit.of_branch() for fit in fits]
    assert np.mean([fit.u_offset_nm for fit in branches]) == pytest.approx(scatter, rel=0.2)
    assert [(one.offset_nm, one.correlation, one.residual_sd_nm) for one in branches] == [
        (one.offset_nm, one.correlation, one.residual_sd_nm) for one in fits
    ]
