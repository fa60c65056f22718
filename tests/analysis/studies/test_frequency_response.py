"""Chirps on a simulated reducer with a load: natural frequency, damping and stiffness come back, noise is gated."""

import math
from functools import cache

import numpy as np
import pytest
from scipy import signal

from analysis.studies.frequency_response import FrequencyResponse, fit_resonance, frequency_response
from analysis.trace.errors import AnalysisError
from definitions.units import ARCMIN_PER_RAD

RATE_HZ = 1000.0
STIFFNESS = 98.0
INERTIA_KG_M2 = 5.0
NATURAL_HZ = math.sqrt(STIFFNESS * ARCMIN_PER_RAD / INERTIA_KG_M2) / (2 * math.pi)


@cache
def response_to_chirp(damping: float, periods: int, period_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Torque ±20 N·m from 5 to 120 Hz, repeated, and wind-up [arcmin] of a rotor on the spring."""
    count = round(period_s * RATE_HZ)
    # 8 times finer, so that the straight line between samples does not filter
    fine = np.arange(periods * count * 8) / (8 * RATE_HZ)
    torque = 20.0 * signal.chirp(np.mod(fine, period_s), 5.0, period_s, 120.0)
    omega = 2 * math.pi * NATURAL_HZ
    rotor = ([omega**2 / STIFFNESS], [1.0, 2 * damping * omega, omega**2])
    # as `lsim`, which takes the same steps in Python, but for the one before the first sample
    (numerator,), denominator, _ = signal.cont2discrete(rotor, 1.0 / (8 * RATE_HZ), method="foh")
    angle = signal.lfilter(numerator, denominator, torque)
    return fine[::8], torque[::8], angle[::8]


def chirp(
    damping: float, *, periods: int = 6, period_s: float = 8.0, noise: float = 0.0, delay: int = 0, seed: int = 1
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t, torque, angle = response_to_chirp(damping, periods, period_s)
    return t, torque, np.roll(angle, delay) + np.random.default_rng(seed).normal(0.0, noise, t.size)


@pytest.mark.parametrize("damping", [0.01, 0.05, 0.2])
def test_repeated_chirp(damping: float) -> None:
    t, torque, angle = chirp(damping, noise=2e-3)
    found = fit_resonance(frequency_response(t, torque, angle, (6.0, 110.0), period_s=8.0))
    assert found.natural_frequency_hz == pytest.approx(NATURAL_HZ, rel=2e-3)
    assert found.damping_ratio == pytest.approx(damping, rel=0.03)
    assert found.stiffness_nm_per_arcmin == pytest.approx(STIFFNESS, rel=0.01)
    assert found.inertia_kg_m2 == pytest.approx(INERTIA_KG_M2, rel=0.01)
    assert abs(found.delay_s) < 1e-4


def test_uncertainties_cover() -> None:
    inside = []
    for seed in range(12):
        t, torque, angle = chirp(0.05, periods=5, period_s=2.0, noise=0.02, seed=seed)
        found = fit_resonance(frequency_response(t, torque, angle, (6.0, 110.0), period_s=2.0))
        inside.append(abs(found.natural_frequency_hz - NATURAL_HZ) < 3 * found.u_natural_frequency_hz)
        inside.append(abs(found.damping_ratio - 0.05) < 3 * found.u_damping_ratio)
        assert found.residual == pytest.approx(1.0, abs=0.4)
    assert sum(inside) >= 22


def test_record_without_a_period() -> None:
    t, torque, angle = chirp(0.05, noise=2e-3)
    found = fit_resonance(frequency_response(t, torque, angle, (6.0, 110.0)))
    assert found.natural_frequency_hz == pytest.approx(NATURAL_HZ, rel=5e-3)
    assert found.damping_ratio == pytest.approx(0.05, rel=0.1)


def test_delay_of_the_angle() -> None:
    t, torque, angle = chirp(0.05, delay=2)
    found = fit_resonance(frequency_response(t, torque, angle, (6.0, 110.0), period_s=8.0))
    assert found.delay_s == pytest.approx(2e-3, abs=1e-4)
    assert found.natural_frequency_hz == pytest.approx(NATURAL_HZ, rel=2e-3)


def test_gate_leaves_noisy_lines_out() -> None:
    t, torque, angle = chirp(0.05, noise=0.1)
    loud = frequency_response(t, torque, angle, (2.0, 400.0), period_s=8.0)
    assert 0 < loud.used.sum() < loud.used.size
    assert (loud.coherence[loud.used] >= 0.9).all()
    # beyond the chirp nothing is excited
    assert not loud.used[loud.frequency_hz > 200.0].any()
    # the response that is left is the rotor on its spring
    ratio = loud.frequency_hz[loud.used] / NATURAL_HZ
    true = 1.0 / STIFFNESS / np.abs(1.0 - ratio**2 + 0.1j * ratio)
    off = np.abs(np.abs(loud.response[loud.used]) / true - 1.0)
    assert off.max() < 0.4
    assert np.mean(off < 2 * loud.u_relative[loud.used]) == pytest.approx(0.95, abs=0.05)


def test_nothing_but_noise_passes_no_gate() -> None:
    t, torque, _ = chirp(0.05)
    noise = np.random.default_rng(4).normal(size=t.size)
    with pytest.raises(AnalysisError, match=r"no frequency reaches a coherence of 0\.999"):
        frequency_response(t, torque, noise, (6.0, 110.0), period_s=8.0, least_coherence=0.999)


def test_no_resonance_in_the_band() -> None:
    t, torque, angle = chirp(0.05)
    with pytest.raises(AnalysisError, match="none between"):
        fit_resonance(frequency_response(t, torque, angle, (60.0, 110.0), period_s=8.0))


def test_too_few_lines() -> None:
    f = np.arange(5.0) + 1
    few = FrequencyResponse(f, f + 0j, np.ones(5), np.full(5, 0.1), np.ones(5, bool), 5.0)
    with pytest.raises(AnalysisError, match="5 frequencies reach the coherence limit"):
        fit_resonance(few)


T = np.arange(1000) / RATE_HZ
X = np.sin(T * 100)


@pytest.mark.parametrize(
    ("t", "x", "y", "band", "period", "said"),
    [
        (T[:10], X[:10], X[:10], (1, 10), None, "of each, 64 or more"),
        (T, X[:-1], X, (1, 10), None, "1000 times, 999 torques"),
        (T**2, X, X, (1, 10), None, "not equally spaced"),
        (T, X, np.full(1000, np.nan), (1, 10), None, "row 1 of angle"),
        (T, X, X, (10, 1), None, "band 10…1 Hz"),
        (T, X, X, (1, 600), None, "up to 500"),
        (T, 0 * X, X, (1, 100), None, "torque does not change"),
        (T, X, X, (1, 100), 0.5, "1 segments of 500"),
        (T, X, X, (1, 100), 0.1005, "100.5 samples"),
    ],
)
def test_wrong_records_are_said(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, band: tuple[float, float], *, period: float | None, said: str
) -> None:
    with pytest.raises(AnalysisError, match=said):
        frequency_response(t, x, y, band, period_s=period)
