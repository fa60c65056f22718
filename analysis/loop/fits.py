"""Fits of the loop's branches: six segments of both branches together, or three regions of each.

Six-segment fit: per branch linear in the middle, quadratic outside. The symmetric pairs of segments are averaged to the
mean curve F; its middle is shifted by the mean of the two gaps at
the seams so that F joins. Source: "backlash and stiffness measurement system".

Three-region fit: quadratic to 20 %, linear to 80 %, quadratic beyond; each side for itself. Source: "inverse loading
test system", stiffness curve derivation. Its regions are of the torque's amount. One parabola through both signs could
not stiffen towards both ends, so either side has regions of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from analysis.loop.branches import Branch, interpolate_rising
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray
from definitions.metrics import FIT_POINTS


@dataclass(frozen=True)
class MeanCurve:
    """Fitted mean curve F(T): coefficients in rising powers of torque [N·m] to arcmin, break torque, seam gaps.

    `middle` is as fitted; `offset_arcmin`, the mean of the gaps, is added to it by `at`.
    """

    break_nm: float
    negative: FloatArray
    middle: FloatArray
    positive: FloatArray

    @property
    def gaps_arcmin(self) -> tuple[float, float]:
        """Gap at the negative and at the positive seam: outside minus middle."""
        below, above = -self.break_nm, self.break_nm
        return (
            _value(self.negative, below) - _value(self.middle, below),
            _value(self.positive, above) - _value(self.middle, above),
        )

    @property
    def offset_arcmin(self) -> float:
        """Mean of the two gaps."""
        return sum(self.gaps_arcmin) / 2.0

    def at(self, torque_nm: FloatArray | float) -> FloatArray:
        """Wind-up F(T) [arcmin]."""
        torque = np.asarray(torque_nm, dtype=np.float64)
        middle = polynomial(self.middle, torque) + self.offset_arcmin
        outside = np.where(torque < 0, polynomial(self.negative, torque), polynomial(self.positive, torque))
        return np.where(np.abs(torque) <= self.break_nm, middle, outside)

    def value_at(self, torque_nm: float) -> float:
        """Wind-up F(T) [arcmin] at one torque, as `at` gives it: a budget asks for it thousands of times."""
        if abs(torque_nm) <= self.break_nm:
            return _value(self.middle, torque_nm) + self.offset_arcmin
        return _value(self.negative if torque_nm < 0.0 else self.positive, torque_nm)

    def stiffness_at(self, torque_nm: float) -> float:
        """Stiffness 1 / F′(T) [N·m/arcmin]."""
        if abs(torque_nm) <= self.break_nm:
            slope = float(self.middle[1])
        else:
            part = self.positive if torque_nm > 0 else self.negative
            slope = float(part[1] + 2.0 * part[2] * torque_nm)
        if slope == 0.0:
            raise AnalysisError(
                f"the fitted mean curve is flat at {torque_nm:g} N·m; its stiffness has no value; choose another torque"
            )
        return 1.0 / slope


@dataclass(frozen=True)
class SixSegmentFit:
    """Coefficients of both branches' segments (rising powers), the torques they were fitted to, and their mean."""

    forward: tuple[FloatArray, FloatArray, FloatArray]
    backward: tuple[FloatArray, FloatArray, FloatArray]
    mean: MeanCurve
    forward_end_nm: tuple[float, float]
    backward_end_nm: tuple[float, float]


def fit_six_segments(
    forward: Branch, backward: Branch, break_nm: float, end_nm: float, exclusion_nm: tuple[float, float]
) -> SixSegmentFit:
    """Fit both branches to ±end_nm, without the torque excluded at the turn that each starts from.

    forward: rising branch, starts from its most negative torque; backward: falling branch, starts from its highest.
    exclusion_nm: torque excluded at the negative end of forward and at the positive end of backward, N·m.
    Raises AnalysisError when less than a quarter of a segment is left to be fitted.
    """
    forward_ends = (
        max(-end_nm, float(forward.torque_nm[0]) + exclusion_nm[0]),
        min(end_nm, float(forward.torque_nm[-1])),
    )
    backward_ends = (
        max(-end_nm, float(backward.torque_nm[0])),
        min(end_nm, float(backward.torque_nm[-1]) - exclusion_nm[1]),
    )
    rising = _fit_branch(forward, break_nm, end_nm, forward_ends)
    falling = _fit_branch(backward, break_nm, end_nm, backward_ends)
    negative, middle, positive = ((rising[part] + falling[part]) / 2.0 for part in range(3))
    return SixSegmentFit(rising, falling, MeanCurve(break_nm, negative, middle, positive), forward_ends, backward_ends)


def _fit_branch(
    branch: Branch, break_nm: float, end_nm: float, ends: tuple[float, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    low, high = ends
    least = break_nm + 0.25 * (end_nm - break_nm)
    if low > -least or high < least:
        raise AnalysisError(
            f"the six-segment fit needs a branch from {-least:.4g} to {least:.4g} N·m at least, without the part "
            f"excluded at the reversal; it has {low:.4g} to {high:.4g} N·m. Load the unit to a higher torque"
        )
    return (
        fit_segment(branch, low, -break_nm, 2),
        fit_segment(branch, -break_nm, break_nm, 1),
        fit_segment(branch, break_nm, high, 2),
    )


def fit_segment(branch: Branch, low_nm: float, high_nm: float, degree: int) -> FloatArray:
    """Least squares polynomial (rising powers) of the wind-up over torque; a segment sees only its own points.

    Raises AnalysisError when the branch has too few points between the two torques [N·m].
    """
    first = int(branch.torque_nm.searchsorted(low_nm, "left"))
    behind = int(branch.torque_nm.searchsorted(high_nm, "right"))
    if behind - first < degree + 2:
        raise AnalysisError(
            f"the segment {low_nm:.4g}…{high_nm:.4g} N·m has {max(behind - first, 0)} points; expected "
            f"{degree + 2} or more; raise the sampling rate or lower the torque rate"
        )
    # as np.linspace, which takes as long as the rest of the fit: a budget makes thousands of these
    torque = _GRID * ((high_nm - low_nm) / (FIT_POINTS - 1)) + low_nm
    torque[-1] = high_nm
    angle = interpolate_rising(branch.torque_nm[first:behind], branch.angle_arcmin[first:behind], torque)
    scaled = (_least_squares(degree) @ angle).tolist()
    # from x in -1…1 to torque: x = offset + slope·T
    slope = 2.0 / (high_nm - low_nm)
    offset = -(high_nm + low_nm) / (high_nm - low_nm)
    powers = ((1.0,), (offset, slope), (offset * offset, 2.0 * offset * slope, slope * slope))
    coefficients = [0.0] * (degree + 1)
    for coefficient, power in zip(scaled, powers, strict=False):
        for place, value in enumerate(power):
            coefficients[place] += coefficient * value
    return np.array(coefficients)


_GRID = np.arange(FIT_POINTS, dtype=np.float64)


@cache
def _least_squares(degree: int) -> FloatArray:
    """Matrix from the values at `FIT_POINTS` even points of -1…1 to the coefficients of their polynomial."""
    points = np.linspace(-1.0, 1.0, FIT_POINTS)
    return np.asarray(np.linalg.pinv(np.polynomial.polynomial.polyvander(points, degree)), dtype=np.float64)


def polynomial(coefficients: FloatArray, torque_nm: FloatArray | float) -> FloatArray:
    """Value of a polynomial with rising powers, to the last bit that of numpy's polyval, which looks at more first."""
    return np.asarray(_horner(coefficients, torque_nm))


def _value(coefficients: FloatArray, torque_nm: float) -> float:
    """Value of a polynomial at one torque."""
    return float(_horner(coefficients, torque_nm))


def _horner(coefficients: FloatArray, torque_nm: FloatArray | float) -> FloatArray | float:
    *lower, highest = coefficients.tolist()
    found: FloatArray | float = highest + torque_nm * 0.0
    for coefficient in reversed(lower):
        found = coefficient + found * torque_nm
    return found


REGION_BORDERS = (0.2, 0.8)
"""End of the low and of the middle region, of the reference torque."""

DEGREES = (2, 1, 2, 2, 1, 2)
"""Degree of each region's polynomial, from the most negative torque upwards."""

LEAST_SHARE = 0.25
"""Share of the outer region that must be left to be fitted after what is excluded at a turning point."""


@dataclass(frozen=True)
class RegionCurve:
    """Wind-up over torque: the five borders [N·m] between six regions, and each region's rising powers to arcmin."""

    borders_nm: FloatArray
    pieces: tuple[FloatArray, ...]

    @property
    def gaps_arcmin(self) -> tuple[float, ...]:
        """Gap at each border, outside minus inside for the outer four; the regions are not shifted to meet."""
        below = [float(polynomial(piece, at)) for piece, at in zip(self.pieces[:-1], self.borders_nm, strict=True)]
        above = [float(polynomial(piece, at)) for piece, at in zip(self.pieces[1:], self.borders_nm, strict=True)]
        return tuple(
            low - high if at < 0 else high - low for low, high, at in zip(below, above, self.borders_nm, strict=True)
        )

    def at(self, torque_nm: FloatArray | float) -> FloatArray:
        """Wind-up [arcmin]; a border belongs to the region towards zero."""
        torque = np.atleast_1d(np.asarray(torque_nm, dtype=np.float64))
        found = np.empty_like(torque)
        regions = self._regions(torque)
        for region, piece in enumerate(self.pieces):
            found[regions == region] = polynomial(piece, torque[regions == region])
        return found if np.ndim(torque_nm) else found[0]

    def value_at(self, torque_nm: float) -> float:
        """Wind-up [arcmin] at one torque, as `at` gives it."""
        return float(self.at(torque_nm))

    def stiffness_at(self, torque_nm: float) -> float:
        """Stiffness [N·m/arcmin], the inverse of the region's slope; AnalysisError where the curve is flat."""
        piece = self.pieces[int(self._regions(np.array([torque_nm]))[0])]
        slope = float(polynomial(piece[1:] * np.arange(1.0, piece.size), torque_nm))
        if slope == 0.0:
            raise AnalysisError(
                f"the fitted curve is flat at {torque_nm:g} N·m; its stiffness has no value; choose another torque"
            )
        return 1.0 / slope

    def _regions(self, torque_nm: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        middle = self.borders_nm.size // 2
        below = np.searchsorted(self.borders_nm[:middle], torque_nm, side="right")
        above = np.searchsorted(self.borders_nm[middle:], torque_nm, side="left")
        return np.asarray(below + above, dtype=np.int64)


def fit_three_regions(
    branch: Branch, reference_nm: float, end_nm: float, excluded_nm: tuple[float, float]
) -> RegionCurve:
    """Fit one branch to ±end_nm, without the torque excluded next to its lowest and to its highest torque [N·m].

    Raises AnalysisError when less than a quarter of an outer region is left.
    """
    low_share, high_share = REGION_BORDERS
    inner, outer = low_share * reference_nm, high_share * reference_nm
    low = max(-end_nm, float(branch.torque_nm[0]) + excluded_nm[0])
    high = min(end_nm, float(branch.torque_nm[-1]) - excluded_nm[1])
    least = outer + LEAST_SHARE * (end_nm - outer)
    if low > -least or high < least:
        raise AnalysisError(
            f"the three-region fit needs a branch from {-least:.4g} to {least:.4g} N·m at least, after what is "
            f"excluded at the reversal; it has {low:.4g} to {high:.4g} N·m; load the unit to a higher torque"
        )
    edges = (low, -outer, -inner, 0.0, inner, outer, high)
    pieces = tuple(
        fit_segment(branch, start, stop, degree)
        for start, stop, degree in zip(edges[:-1], edges[1:], DEGREES, strict=True)
    )
    return RegionCurve(np.array(edges[1:-1]), pieces)


def mean_of(first: RegionCurve, second: RegionCurve) -> RegionCurve:
    """Mean of two curves with the same borders."""
    pieces = tuple((one + other) / 2.0 for one, other in zip(first.pieces, second.pieces, strict=True))
    return RegionCurve(first.borders_nm, pieces)
