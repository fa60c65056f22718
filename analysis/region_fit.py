"""Three-region fit of a branch: quadratic to 20 %, linear to 80 %, quadratic beyond; each side for itself.

Source: "inverse loading test system", stiffness curve derivation. Its regions are of the torque's amount. One parabola
through both signs could not stiffen towards both ends, so either side has regions of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.branches import Branch
from analysis.errors import AnalysisError
from analysis.segment_fit import fit_segment, polynomial
from analysis.units import FloatArray

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

    def stiffness_at(self, torque_nm: float) -> float:
        """Stiffness [N·m/arcmin], the inverse of the region's slope; AnalysisError where the curve is flat."""
        piece = self.pieces[int(self._regions(np.array([torque_nm]))[0])]
        slope = float(polynomial(piece[1:] * np.arange(1.0, piece.size), torque_nm))
        if slope == 0.0:
            raise AnalysisError(f"the fitted curve is flat at {torque_nm:g} N·m; its stiffness has no value")
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
            f"excluded at the reversal; it has {low:.4g} to {high:.4g} N·m; load the unit further"
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
