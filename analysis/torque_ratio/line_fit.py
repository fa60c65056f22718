"""Torque ratio of a reducer: T_out = C + m·T_in by least squares, with what is needed to trust it.

Source: "inverse loading test system" and "backlash and stiffness measurement system" (torque ratio calibration).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.torque_ratio.neighbours import alike
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray, IntArray

FLAG_STUDENTISED = 4.0
"""Externally studentised residuals beyond this are flagged as outliers."""

LEAST_POINTS = 3
"""Pairs that a line with an uncertainty needs."""

THEIL_SEN_POINTS = 500
"""The Theil–Sen estimate takes at most this many points, evenly picked: it needs memory by the square."""


@dataclass(frozen=True)
class RatioFit:
    """Ordinary least squares of output torque on input torque: T_out = offset_nm + slope · T_in.

    residual_sd_nm s, standard uncertainties u_offset_nm and u_slope, correlation of the two, r_squared, externally
    studentised residuals and the indices flagged by them. The pairs themselves are inputs_nm, outputs_nm.
    """

    offset_nm: float
    slope: float
    residual_sd_nm: float
    u_offset_nm: float
    u_slope: float
    correlation: float
    r_squared: float
    studentised: FloatArray
    flagged: IntArray
    points: int
    inputs_nm: FloatArray
    outputs_nm: FloatArray

    @property
    def theil_sen_offset_nm(self) -> float:
        """Offset of the Theil–Sen line, through the medians of both torques: a check that outliers cannot move."""
        return self._theil_sen[0]

    @property
    def theil_sen_slope(self) -> float:
        """Slope of the Theil–Sen line."""
        return self._theil_sen[1]

    @cached_property
    def _theil_sen(self) -> tuple[float, float]:
        # when it is asked for: most lines are fitted for a check, and it takes ten times as long as they do
        return _theil_sen(self.inputs_nm, self.outputs_nm)

    def torque_out_nm(self, torque_in_nm: FloatArray | float) -> FloatArray | float:
        """Output torque [N·m] for an input torque [N·m]."""
        return self.offset_nm + self.slope * torque_in_nm

    def torque_in_nm(self, torque_out_nm: float) -> float:
        """Input torque [N·m] that gives an output torque [N·m]: the target of a test."""
        return (torque_out_nm - self.offset_nm) / self.slope

    def u_torque_out_nm(self, torque_in_nm: float) -> float:
        """Return the standard uncertainty of the line's output torque: u² = u_C² + T_in² u_m² + 2 T_in cov(C, m)."""
        covariance = self.correlation * self.u_offset_nm * self.u_slope
        variance = self.u_offset_nm**2 + (torque_in_nm * self.u_slope) ** 2 + 2.0 * torque_in_nm * covariance
        return math.sqrt(max(variance, 0.0))

    def u_torque_in_nm(self, torque_out_nm: float) -> float:
        """Return the standard uncertainty of the input torque for an output torque: that of the line, over its slope.

        What one loading differs from the line by (residual_sd_nm) is not in it.
        """
        return self.u_torque_out_nm(self.torque_in_nm(torque_out_nm)) / abs(self.slope)

    def of_branch(self) -> RatioFit:
        """Return the fit of points in the order of a branch: its uncertainty knows that neighbours err alike."""
        residuals = self.outputs_nm - self.offset_nm - self.slope * self.inputs_nm
        larger = math.sqrt(alike(residuals))
        return replace(self, u_offset_nm=larger * self.u_offset_nm, u_slope=larger * self.u_slope)

    def without_flagged(self) -> RatioFit | None:
        """Return the fit of what is not flagged; None where nothing is flagged, or too little is left for a line."""
        kept = np.setdiff1d(np.arange(self.points), self.flagged)
        if kept.size == self.points or np.unique(self.inputs_nm[kept]).size < LEAST_POINTS:
            return None
        return fit_torque_ratio(self.inputs_nm[kept], self.outputs_nm[kept])


def fit_torque_ratio(torque_in_nm: FloatArray, torque_out_nm: FloatArray) -> RatioFit:
    """Fit T_out = C + m·T_in to pairs of torques [N·m].

    Raises AnalysisError for fewer than three points, values that are not finite, or input torques that are all equal.
    """
    x = np.asarray(torque_in_nm, dtype=np.float64)
    y = np.asarray(torque_out_nm, dtype=np.float64)
    if x.size != y.size or x.size < LEAST_POINTS:
        raise AnalysisError(f"torque ratio: found {x.size} input and {y.size} output torques; expected 3 pairs or more")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        at = int(np.argmax(~(np.isfinite(x) & np.isfinite(y))))
        raise AnalysisError(
            f"torque ratio: pair {at + 1}: found {x[at]:g} and {y[at]:g}; expected two numbers. Remove the pair"
        )
    n = x.size
    x_mean = float(x.mean())
    s_xx = float(np.square(x - x_mean).sum())
    if s_xx <= 1e-12 * max(1.0, x_mean * x_mean) * n:
        raise AnalysisError(f"torque ratio: every input torque is {x_mean:g} N·m; expected a rising torque")
    slope = float(((x - x_mean) * (y - y.mean())).sum()) / s_xx
    offset = float(y.mean()) - slope * x_mean
    residuals = y - offset - slope * x
    sum_of_squares = float(np.square(residuals).sum())
    variance = sum_of_squares / (n - 2)
    total = float(np.square(y - y.mean()).sum())
    studentised = _studentised(residuals, 1.0 / n + np.square(x - x_mean) / s_xx, sum_of_squares)
    mean_square = float(np.square(x).mean())
    return RatioFit(
        offset_nm=offset,
        slope=slope,
        residual_sd_nm=math.sqrt(variance),
        u_offset_nm=math.sqrt(variance * mean_square / s_xx),
        u_slope=math.sqrt(variance / s_xx),
        correlation=-x_mean / math.sqrt(mean_square),
        r_squared=1.0 - sum_of_squares / total if total > 0 else 0.0,
        studentised=studentised,
        flagged=np.flatnonzero(np.abs(studentised) > FLAG_STUDENTISED).astype(np.int64),
        points=n,
        inputs_nm=x,
        outputs_nm=y,
    )


def _studentised(residuals: FloatArray, leverage: FloatArray, sum_of_squares: float) -> FloatArray:
    """Residuals over their standard deviation estimated without the point itself; zeroes for an exact line."""
    n = residuals.size
    free = np.maximum(1.0 - leverage, 1e-12)
    if n < 4 or sum_of_squares <= 0.0:
        return np.zeros(n)
    variance_without = np.maximum(sum_of_squares - np.square(residuals) / free, 0.0) / (n - 3)
    floor = 1e-18 * sum_of_squares
    studentised: FloatArray = residuals / np.sqrt(np.maximum(variance_without, floor) * free)
    return studentised


def _theil_sen(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Offset and slope by Theil–Sen."""
    if x.size > THEIL_SEN_POINTS:
        picked = np.linspace(0, x.size - 1, THEIL_SEN_POINTS).astype(np.int64)
        x, y = x[picked], y[picked]
    # scipy.stats has it too, but takes a third of a second to load, in every command
    first, second = np.triu_indices(x.size, k=1)
    apart = x[second] - x[first]
    differ = apart != 0.0
    slope = float(np.median((y[second] - y[first])[differ] / apart[differ]))
    return float(np.median(y)) - slope * float(np.median(x)), slope
