"""Frequency response of a reducer from a torque chirp, and its natural frequency and damping with a load.

H1 = S_xy / S_xx of wind-up over torque does not see noise of the angle; the coherence says how much of the angle the
torque explains, and decides which lines are used. Source: J. Bendat and A. Piersol, "Random Data", 9.1.
The resonance is fitted by complex least squares: one degree of freedom, compliance form,
H = C / (1 − (f/f₀)² + 2iζ f/f₀) · exp(−2πi f τ), with τ the delay of the angle behind the torque. Magnitude and phase
count together, each line by its own uncertainty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy  # loads optimize and signal where they are used

from analysis.trace.errors import AnalysisError
from analysis.trace.units import BoolArray, FloatArray
from definitions.units import ARCMIN_PER_RAD

LEAST_COHERENCE = 0.9
"""Smallest coherence of the lines to use."""

LEAST_AVERAGES = 3
"""With one segment the coherence is 1 whatever was measured."""

SEGMENTS = 12
"""Half overlapping segments that a record without a period is cut into."""

SMOOTHED_LINES = 15
"""Lines over which the noise is averaged."""

LARGEST_JITTER = 0.01
"""Share of a sample period by which sample times may stray."""

LEAST_LINES = 8
"""Four parameters from complex lines: with fewer there is nothing left to judge the fit by."""

NOISE_FLOOR = 1e-4
"""Relative uncertainty of a line is taken to be at least this: coherence near 1 is not infinite knowledge."""


@dataclass(frozen=True)
class FrequencyResponse:
    """Compliance H [arcmin/(N·m)] per line: frequency [Hz], coherence 0…1, relative standard uncertainty of |H|.

    used: lines whose coherence passes its limit and that the torque excites; averages: independent segments.
    """

    frequency_hz: FloatArray
    response: np.typing.NDArray[np.complex128]
    coherence: FloatArray
    u_relative: FloatArray
    used: BoolArray
    averages: float


def frequency_response(
    t_s: FloatArray,
    torque_nm: FloatArray,
    angle_arcmin: FloatArray,
    band_hz: tuple[float, float],
    *,
    period_s: float | None = None,
    least_coherence: float = LEAST_COHERENCE,
) -> FrequencyResponse:
    """Estimate wind-up over torque in a band, from equally spaced samples.

    period_s: the chirp repeats with this period; then segments are whole periods without a window, the first one is
    left out (it holds the transient), and there is no leakage. None cuts into 12 half overlapping segments under a Hann
    window. Raises AnalysisError for lengths that differ, samples that are not equally spaced, fewer than 3 segments, a
    band beyond half the sample rate, or no line whose coherence passes.
    """
    t, x, y = (np.asarray(row, dtype=np.float64) for row in (t_s, torque_nm, angle_arcmin))
    step = _checked_step(t, x, y)
    low, high = band_hz
    if not 0.0 < low < high <= 0.5 / step:
        raise AnalysisError(
            f"frequency response: band {low:g}…{high:g} Hz; expected a rising band above 0, up to {0.5 / step:g} Hz"
        )
    length, overlap, window = _segments(t.size, step, period_s)
    if period_s is not None:
        x, y = x[length:], y[length:]
    count = (x.size - overlap) // (length - overlap)
    # Hann segments that overlap by half count for a little less than two thirds each (Welch)
    averages = float(count) if period_s is not None else 1.0 + 0.62 * (count - 1)
    if count < LEAST_AVERAGES:
        raise AnalysisError(
            f"frequency response: {count} segments of {length} samples; expected {LEAST_AVERAGES} or more to compute "
            f"the coherence; record longer, or more periods"
        )
    options = {"fs": 1.0 / step, "window": window, "nperseg": length, "noverlap": overlap, "detrend": "constant"}
    frequency, s_xx = scipy.signal.welch(x, **options)
    _, s_yy = scipy.signal.welch(y, **options)
    _, s_xy = scipy.signal.csd(x, y, **options)
    inside = (frequency >= low) & (frequency <= high)
    if not inside.any() or float(s_xx[inside].max()) <= 0.0:
        raise AnalysisError("frequency response: the torque does not change within the band; check the chirp")
    frequency, s_xx, s_yy, s_xy = frequency[inside], s_xx[inside], s_yy[inside], s_xy[inside]
    excited = s_xx > 1e-6 * float(s_xx.max())
    response = np.divide(s_xy, s_xx, out=np.zeros_like(s_xy), where=excited)
    coherence = np.divide(np.abs(s_xy) ** 2, s_xx * s_yy, out=np.zeros_like(s_xx), where=excited & (s_yy > 0.0))
    coherence = np.clip(coherence, 0.0, 1.0)
    # with few averages the coherence of one line scatters: noise is judged with its neighbours, or luck passes
    noise = _smooth(s_yy * (1.0 - coherence)) * averages / (averages - 1.0)
    explained = np.abs(response) ** 2 * s_xx
    used = excited & (coherence >= least_coherence) & (explained >= least_coherence * (explained + noise))
    if not used.any():
        alone = excited & (coherence >= least_coherence)
        among = f"; {int(alone.sum())} reach it alone, but not with their neighbours" if alone.any() else ""
        raise AnalysisError(
            f"frequency response: no frequency reaches a coherence of {least_coherence:g} "
            f"(best {coherence.max():.3f}{among}); "
            "raise the amplitude of the chirp, or lower the coherence limit"
        )
    u_relative = np.sqrt(noise / np.maximum(2.0 * averages * explained, 1e-300))
    return FrequencyResponse(frequency, response, coherence, u_relative, used, averages)


def _checked_step(t: FloatArray, x: FloatArray, y: FloatArray) -> float:
    if not t.ndim == x.ndim == y.ndim == 1 or not t.size == x.size == y.size or t.size < 64:
        raise AnalysisError(
            f"frequency response: found {t.size} times, {x.size} torques and {y.size} angles; expected the same number "
            "of each, 64 or more. Record longer"
        )
    for name, row in (("t_s", t), ("torque", x), ("angle", y)):
        bad = ~(np.abs(row) <= 1e9)
        if bad.any():
            at = int(np.argmax(bad))
            raise AnalysisError(
                f"frequency response: row {at + 1} of {name}: found {row[at]:g}; expected a number within ±1e9. "
                "Correct the value in the file"
            )
    step = float(t[-1] - t[0]) / (t.size - 1)
    if step <= 0.0 or float(np.abs(np.diff(t) - step).max()) > LARGEST_JITTER * step:
        raise AnalysisError(
            f"frequency response: the samples are not equally spaced (mean step {step:g} s); resample the record first"
        )
    return step


def _smooth(power: FloatArray) -> FloatArray:
    """Mean over neighbouring lines, fewer at the ends."""
    window = np.ones(min(SMOOTHED_LINES, power.size))
    total: FloatArray = np.convolve(power, window, "same") / np.convolve(np.ones_like(power), window, "same")
    return total


def _segments(size: int, step: float, period_s: float | None) -> tuple[int, int, str]:
    """Samples per segment, samples that segments share, and the window."""
    if period_s is None:
        length = 2 * size // (SEGMENTS + 1)
        return length, length // 2, "hann"
    length = round(period_s / step)
    if length < 16 or abs(length * step - period_s) > LARGEST_JITTER * step:
        raise AnalysisError(
            f"frequency response: a period of {period_s:g} s is {period_s / step:.4g} samples; expected whole "
            "samples, 16 or more; choose period and sample rate together"
        )
    return length, 0, "boxcar"


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
    """Fit one resonance to the lines that passed.

    Uncertainties are enlarged by the residual where the model fits worse than the noise. Raises AnalysisError for fewer
    than 8 lines, no resonance between the first and the last of them, or a fit that does not end.
    """
    f, h = found.frequency_hz[found.used], found.response[found.used]
    if f.size < LEAST_LINES:
        raise AnalysisError(
            f"resonance: {f.size} frequencies reach the coherence limit; "
            f"expected {LEAST_LINES} or more; record longer, or raise the amplitude of the chirp"
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
            fits = [
                scipy.optimize.least_squares(residual, start, x_scale=[1, 1, 1, 1e-3], max_nfev=400) for start in starts
            ]
    except (ValueError, np.linalg.LinAlgError) as error:
        raise AnalysisError(f"resonance: the fit fails: {error}; check the measured response") from error
    best = min(fits, key=lambda fit: float(fit.cost))
    compliance, natural, damping = np.exp(best.x[:3]).tolist()
    if best.status <= 0 or not f[0] <= natural <= f[-1]:
        raise AnalysisError(
            f"resonance: none between {f[0]:.4g} and {f[-1]:.4g} Hz; widen the band of the sweep, or check the "
            "coherence"
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
