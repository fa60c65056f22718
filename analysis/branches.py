"""Branches of the loop: wind-up over torque, noise averaged, each branch a single-valued curve.

Samples of a branch are averaged in blocks along time (torque and angle alike, so that noise in the torque does not
tilt the curve), then the torque is made to rise with the branch by monotone regression. What is left is interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from analysis.errors import AnalysisError
from analysis.method import Method
from analysis.trace import Trace
from analysis.units import ARCMIN_PER_RAD, FloatArray

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

    @property
    def least_nm(self) -> float:
        """Lowest torque that can be evaluated."""
        return float(self.torque_nm[0]) - self._beyond

    @property
    def most_nm(self) -> float:
        """Highest torque that can be evaluated."""
        return float(self.torque_nm[-1]) + self._beyond

    @property
    def _beyond(self) -> float:
        return BEYOND_ENDS * float(self.torque_nm[-1] - self.torque_nm[0])

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
                f"the branch covers {self.torque_nm[0]:.4g}…{self.torque_nm[-1]:.4g} N·m and is asked for "
                f"{asked} N·m; load the unit further or lower the reference torque"
            )
        return interpolate(self.torque_nm, self.angle_arcmin, wanted)


def interpolate(x: FloatArray, y: FloatArray, wanted: FloatArray) -> FloatArray:
    """Linear interpolation, continued straight beyond the ends with the slope of the last percent of the points."""
    result = np.asarray(np.interp(wanted, x, y))
    reach = max(1, x.size // 100)
    for end, inner, beyond in ((0, reach, wanted < x[0]), (-1, -1 - reach, wanted > x[-1])):
        if beyond.any():
            slope = (y[inner] - y[end]) / (x[inner] - x[end])
            result = np.where(beyond, y[end] + slope * (wanted - x[end]), result)
    return result


def make_branch(torque_nm: FloatArray, windup_arcmin: FloatArray, direction: int, where: str) -> Branch:
    """Reduce the samples of one run, in order of time, to a branch.

    direction: +1 torque rising, -1 falling. Raises AnalysisError for too few samples or a torque that runs the other
    way, naming where.
    """
    if torque_nm.size < LEAST_POINTS:
        raise AnalysisError(
            f"{where}: found {torque_nm.size} samples; needed are {LEAST_POINTS} or more; sample faster or load slower"
        )
    size = -(-torque_nm.size // MOST_BLOCKS)
    edges = np.arange(0, torque_nm.size, size)
    counts = np.diff(np.append(edges, torque_nm.size)).astype(np.float64)
    torque = np.add.reduceat(torque_nm, edges) / counts
    angle = np.add.reduceat(windup_arcmin, edges) / counts
    if direction < 0:
        torque, angle, counts = torque[::-1], angle[::-1], counts[::-1]
    tenth = max(1, torque.size // 10)
    if not torque[-tenth:].mean() > torque[:tenth].mean():
        raise AnalysisError(
            f"{where}: torque should be {'rising' if direction > 0 else 'falling'} and goes from {torque_nm[0]:.4g} to "
            f"{torque_nm[-1]:.4g} N·m; name the direction of the segment as it was run"
        )
    return monotone(torque, angle, counts)


def monotone(torque: FloatArray, angle: FloatArray, counts: FloatArray) -> Branch:
    """Monotone regression of the torque [N·m] along the branch; points that it makes equal are averaged.

    angle: wind-up [arcmin]; counts: samples behind each point.
    """
    if not (np.diff(torque) > 0).all():
        fitted = optimize.isotonic_regression(torque, weights=counts)
        starts = fitted.blocks[:-1]
        weights = np.add.reduceat(counts, starts)
        angle = np.add.reduceat(angle * counts, starts) / weights
        torque = fitted.x[starts]
    return Branch(np.ascontiguousarray(torque), np.ascontiguousarray(angle))


def measured_windup(trace: Trace, method: Method) -> tuple[FloatArray, bool, str]:
    """Wind-up of the whole trace [arcmin], whether the fixture's deflection is still in it, and how it was made.

    With both encoders: loaded shaft minus locked shaft, at the output. With one: the input angle over the ratio when
    the input is loaded, or the output angle; with input loading an output angle alone is a wind-up that somebody has
    made already. AnalysisError when there is no angle to take.
    """
    angle_in, angle_out = trace.angle_in_rad, trace.angle_out_rad
    to_output = ARCMIN_PER_RAD / method.ratio
    if angle_in is not None and angle_out is not None:
        windup = angle_in * to_output - angle_out * ARCMIN_PER_RAD
        if method.loading == "input":
            return windup, False, "wind-up = angle_in / ratio − angle_out"
        return -windup, False, "wind-up = angle_out − angle_in / ratio"
    if method.loading == "input" and angle_in is not None:
        return angle_in * to_output, True, "wind-up = angle_in / ratio; the locked output was not measured"
    if method.loading == "output":
        windup = trace.channel("angle_out_rad", "the wind-up") * ARCMIN_PER_RAD
        return windup, True, "wind-up = angle_out; the locked input was not measured"
    if angle_out is not None:
        return angle_out * ARCMIN_PER_RAD, False, "wind-up = angle_out as given; there is no input angle in the trace"
    return trace.channel("angle_in_rad", "the wind-up"), True, ""
