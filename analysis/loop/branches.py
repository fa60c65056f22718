"""Branches of the loop: wind-up over torque, noise averaged, each branch a single-valued curve.

Samples of a branch are averaged in blocks along time (torque and angle alike, so that noise in the torque does not
tilt the curve), then the torque is made to rise with the branch by monotone regression. What is left is interpolated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy  # loads optimize where it is used

from analysis.loop.samples import BranchSamples
from analysis.loop.stages import Figure, StageRecord
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

MOST_BLOCKS = 3000
"""Points per branch at most; a branch with fewer samples keeps them all."""

LEAST_POINTS = 20
"""Points per branch at least."""

BEYOND_ENDS = 0.005
"""Share of a branch's torque range that may be extrapolated: what averaging in blocks takes from its ends."""


@dataclass(frozen=True)
class Branch:
    """Wind-up [arcmin] over strictly rising torque [N·m]."""

    torque_nm: FloatArray
    angle_arcmin: FloatArray

    @cached_property
    def rising_arcmin(self) -> FloatArray:
        """Wind-up that never falls with the torque: at each point the largest up to there."""
        return np.asarray(np.maximum.accumulate(self.angle_arcmin))

    @cached_property
    def _ends_nm(self) -> tuple[float, float]:
        return float(self.torque_nm[0]), float(self.torque_nm[-1])

    @property
    def least_nm(self) -> float:
        """Lowest torque that can be evaluated."""
        return self._ends_nm[0] - self._beyond

    @property
    def most_nm(self) -> float:
        """Highest torque that can be evaluated."""
        return self._ends_nm[1] + self._beyond

    @property
    def _beyond(self) -> float:
        return BEYOND_ENDS * (self._ends_nm[1] - self._ends_nm[0])

    def covers(self, low_nm: float, high_nm: float) -> bool:
        """Say whether the branch can be evaluated from one torque to the other."""
        return self.least_nm <= low_nm and high_nm <= self.most_nm

    def at(self, torque_nm: FloatArray) -> FloatArray:
        """Wind-up [arcmin] at torques [N·m]; AnalysisError beyond the ends."""
        wanted = np.asarray(torque_nm, dtype=np.float64)
        low, high = float(wanted.min()), float(wanted.max())
        if not self.covers(low, high):
            asked = f"{low:.4g}" if low == high else f"{low:.4g}…{high:.4g}"
            raise AnalysisError(
                f"the branch covers {self.torque_nm[0]:.4g}…{self.torque_nm[-1]:.4g} N·m, but a value is needed at "
                f"{asked} N·m; load the unit to a higher torque or lower the reference torque"
            )
        return interpolate(self.torque_nm, self.angle_arcmin, wanted)

    def value_at(self, torque_nm: float) -> float:
        """Wind-up [arcmin] at one torque [N·m], as `at` gives it; AnalysisError beyond the ends."""
        first, last = self._ends_nm
        if first <= torque_nm <= last:
            return float(np.interp(torque_nm, self.torque_nm, self.angle_arcmin))
        return float(self.at(np.array([torque_nm]))[0])


def interpolate(x: FloatArray, y: FloatArray, wanted: FloatArray) -> FloatArray:
    """Linear interpolation, continued straight beyond the ends with the slope of the last percent of the points."""
    result = np.asarray(np.interp(wanted, x, y))
    reach = max(1, x.size // 100)
    if wanted.min() < x[0]:
        beyond = wanted < x[0]
        result[beyond] = y[0] + _slope(x, y, 0, reach) * (wanted[beyond] - x[0])
    if wanted.max() > x[-1]:
        beyond = wanted > x[-1]
        result[beyond] = y[-1] + _slope(x, y, -1, -1 - reach) * (wanted[beyond] - x[-1])
    return result


def interpolate_rising(x: FloatArray, y: FloatArray, wanted: FloatArray) -> FloatArray:
    """As `interpolate`, at rising places: those beyond the ends come first and last."""
    result = np.asarray(np.interp(wanted, x, y))
    reach = max(1, x.size // 100)
    first, last = float(x[0]), float(x[-1])
    if wanted[0] < first:
        before = int(wanted.searchsorted(first, "left"))
        result[:before] = y[0] + _slope(x, y, 0, reach) * (wanted[:before] - first)
    if wanted[-1] > last:
        behind = int(wanted.searchsorted(last, "right"))
        result[behind:] = y[-1] + _slope(x, y, -1, -1 - reach) * (wanted[behind:] - last)
    return result


def _slope(x: FloatArray, y: FloatArray, end: int, inner: int) -> float:
    return float((y[inner] - y[end]) / (x[inner] - x[end]))


class Blocks(NamedTuple):
    """Means of a branch's samples in blocks along time; time is None when it was not measured."""

    torque_nm: FloatArray
    angle_arcmin: FloatArray
    t_s: FloatArray | None
    counts: FloatArray


def binned(samples: BranchSamples) -> Blocks:
    """Average the samples of a branch in at most `MOST_BLOCKS` blocks along time.

    Raises AnalysisError for too few samples, naming the branch.
    """
    found = samples.torque_nm.size
    if found < LEAST_POINTS:
        raise AnalysisError(
            f"{samples.where}: found {found} samples; expected {LEAST_POINTS} or more; raise the sampling rate or "
            f"lower the torque rate"
        )
    size = -(-found // MOST_BLOCKS)
    if size == 1:
        return Blocks(samples.torque_nm, samples.windup_arcmin, samples.t_s, np.ones(found))
    edges = np.arange(0, found, size)
    counts = np.diff(np.append(edges, found)).astype(np.float64)
    time = None if samples.t_s is None else np.add.reduceat(samples.t_s, edges) / counts
    torque = np.add.reduceat(samples.torque_nm, edges) / counts
    return Blocks(torque, np.add.reduceat(samples.windup_arcmin, edges) / counts, time, counts)


def monotone(blocks: Blocks, direction: int, where: str) -> Branch:
    """Make a branch of its blocks by monotone regression of the torque along it.

    direction: +1 torque rising, -1 falling. Points that the regression makes equal are averaged. Raises AnalysisError
    for a torque that runs the other way, naming where.
    """
    torque, angle, counts = blocks.torque_nm, blocks.angle_arcmin, blocks.counts
    first, last = float(torque[0]), float(torque[-1])
    if direction < 0:
        torque, angle, counts = torque[::-1], angle[::-1], counts[::-1]
    tenth = max(1, torque.size // 10)
    if not torque[-tenth:].mean() > torque[:tenth].mean():
        raise AnalysisError(
            f"{where}: torque should be {'rising' if direction > 0 else 'falling'} but goes from {first:.4g} to "
            f"{last:.4g} N·m; correct the direction of the segment"
        )
    return made_rising(torque, angle, counts)


def made_rising(torque: FloatArray, angle: FloatArray, counts: FloatArray) -> Branch:
    """Monotone regression of a torque [N·m] that should rise; points that it makes equal are averaged.

    angle: wind-up [arcmin]; counts: samples behind each point.
    """
    if not (np.diff(torque) > 0).all():
        fitted = scipy.optimize.isotonic_regression(torque, weights=counts)
        starts = fitted.blocks[:-1]
        angle = np.add.reduceat(angle * counts, starts) / fitted.weights
        torque = fitted.x[starts]
    return Branch(np.ascontiguousarray(torque), np.ascontiguousarray(angle))


def branch_records(
    pairs: Sequence[tuple[BranchSamples, BranchSamples]], blocks: Sequence[Blocks], branches: Sequence[Branch]
) -> list[StageRecord]:
    """Say how samples became branches: pairing, blocks, and points that monotone regression made equal."""
    samples = sum(one.torque_nm.size for pair in pairs for one in pair)
    points = sum(one.torque_nm.size for one in blocks)
    kept = sum(one.torque_nm.size for one in branches)
    largest = max(float(one.counts.max()) for one in blocks)
    return [
        StageRecord("branches", f"cycles: {len(pairs)}", {"cycles": Figure(len(pairs), "1")}),
        StageRecord(
            "binning",
            f"binning: {samples} samples to {points} blocks of {largest:.0f} samples at most",
            {"samples": Figure(samples, "1"), "blocks": Figure(points, "1"), "largest block": Figure(largest, "1")},
            applied=points < samples,
        ),
        StageRecord(
            "monotone regression",
            f"monotone regression: {points} points to {kept} of strictly rising torque",
            {"points": Figure(kept, "1"), "made equal": Figure((points - kept) / points * 100.0, "%")},
            applied=kept < points,
        ),
    ]
