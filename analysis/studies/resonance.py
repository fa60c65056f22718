"""Natural frequency and damping of a reducer with a load, by complex least squares on its frequency response.

One degree of freedom, compliance form: H = C / (1 − (f/f₀)² + 2iζ f/f₀) · exp(−2πi f τ), with τ the delay of the angle
behind the torque. Magnitude and phase count together, each line by its own uncertainty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from analysis.studies.frequency_response import FrequencyResponse
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray
from definitions.units import ARCMIN_PER_RAD

LEAST_LINES = 8
"""Four parameters from complex lines: with fewer there is nothing left to judge the fit by."""

NOISE_FLOOR = 1e-4
"""Relative uncertainty of a line is taken to be at least this: coherence near 1 is not infinite knowledge."""


@dataclass(frozen=True)
class Resonance:
    """Natural frequency [Hz], damping ratio, static compliance [arcmin/(N·m)], delay [s], with standard uncertainties.

    residual: rms of the weighted complex residuals, 1 where the model fits within the noise.
    """

    natural_frequency_hz: float
    u_natural_frequency_hz: float
    damping_ratio: float
    u_damping_ratio: float
    compliance_arcmin_per_nm: float
    u_compliance_arcmin_per_nm: float
    delay_s: float
    u_delay_s: float
    residual: float
    lines: int

    @property
    def stiffness_nm_per_arcmin(self) -> float:
        """Dynamic stiffness [N·m/arcmin]: the static value of the fitted response."""
        return 1.0 / self.compliance_arcmin_per_nm

    @property
    def inertia_kg_m2(self) -> float:
        """Inertia [kg·m²] that this stiffness and natural frequency belong to: K / ω₀²."""
        omega = 2.0 * math.pi * self.natural_frequency_hz
        return self.stiffness_nm_per_arcmin * ARCMIN_PER_RAD / omega**2


def fit_resonance(found: FrequencyResponse) -> Resonance:
    """Fit one resonance to the lines that passed the gate.

    Uncertainties are enlarged by the residual where the model fits worse than the noise. Raises AnalysisError for fewer
    than 8 lines, no resonance between the first and the last of them, or a fit that does not end.
    """
    f, h = found.frequency_hz[found.used], found.response[found.used]
    if f.size < LEAST_LINES:
        raise AnalysisError(
            f"resonance: {f.size} lines reach the coherence limit; "
            f"expected {LEAST_LINES} or more; record longer or excite more"
        )
    weight = 1.0 / (np.abs(h) * np.maximum(found.u_relative[found.used], NOISE_FLOOR))
    static = float(np.median(np.abs(h[: max(3, f.size // 20)])))

    def residual(x: FloatArray) -> FloatArray:
        difference = (_response(f, x) - h) * weight
        return np.concatenate([difference.real, difference.imag])

    peak = float(f[int(np.argmax(np.abs(h) * f))])
    starts = [[*np.log([static, peak, damping]).tolist(), 0.0] for damping in (0.01, 0.05, 0.3)]
    try:
        with np.errstate(all="ignore"):
            fits = [optimize.least_squares(residual, start, x_scale=[1, 1, 1, 1e-3], max_nfev=400) for start in starts]
    except (ValueError, np.linalg.LinAlgError) as error:
        raise AnalysisError(f"resonance: the fit fails: {error}; look at the response") from error
    best = min(fits, key=lambda fit: float(fit.cost))
    compliance, natural, damping = np.exp(best.x[:3]).tolist()
    if best.status <= 0 or not f[0] <= natural <= f[-1]:
        raise AnalysisError(
            f"resonance: none between {f[0]:.4g} and {f[-1]:.4g} Hz (the fit goes to {natural:.4g} Hz); widen the "
            "chirp or look at the coherence"
        )
    chi = 2.0 * float(best.cost) / (2 * f.size - 4)
    covariance = np.linalg.pinv(best.jac.T @ best.jac, hermitian=True) * max(1.0, chi)
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist()
    return Resonance(
        natural, natural * u[1], damping, damping * u[2], compliance, compliance * u[0], float(best.x[3]), u[3],
        math.sqrt(chi), f.size,
    )  # fmt: skip


def _response(f: FloatArray, x: FloatArray) -> np.typing.NDArray[np.complex128]:
    """Response for ln C, ln f₀, ln ζ and τ."""
    ratio = f / np.exp(x[1])
    model: np.typing.NDArray[np.complex128] = (
        np.exp(x[0]) / (1.0 - ratio**2 + 2j * np.exp(x[2]) * ratio) * np.exp(-2j * math.pi * f * x[3])
    )
    return model
