"""One cycle of the hysteresis loop: both branches, their friction, the zones next to the turning points, and the fit.

Words: forward is the branch of rising torque, return the one of falling torque. On the positive side the loading
branch is forward and the unloading branch is return; on the negative side it is the other way round.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from analysis.loop.branches import Branch
from analysis.loop.fits import MeanCurve, RegionCurve, SixSegmentFit, fit_six_segments
from analysis.loop.method import Method
from analysis.loop.stages import Figure, StageRecord
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

MIDDLE_OF_LOOP = (0.25, 0.75)
"""Share of the angle between the turning points over which the friction torque is read."""

STEEP = (1.0 / 3.0, 2.0 / 3.0)
"""By which share a branch leaves its turn steeper than the other arrived, until friction has reversed.

From the first share on a part of the friction counts as reversing there, from the second on all of it."""

REVERSED = 0.95
"""Share of the height of the loop after a turn from which on friction counts as reversed."""

DEPTHS = 65
"""Torques after a turn at which the height of the loop is read."""

_MIDDLE = np.linspace(*MIDDLE_OF_LOOP, 501)
_DEPTHS = np.arange(DEPTHS, dtype=np.float64)

Curve = MeanCurve | RegionCurve
"""What a fit makes of wind-up over torque."""


class FittedCurves(NamedTuple):
    """Fitted curves of both branches and of their mean."""

    forward: Curve
    backward: Curve
    mean: Curve


@dataclass(frozen=True)
class Loop:
    """Forward and return branch of one cycle, evaluated by one method."""

    forward: Branch
    backward: Branch
    method: Method

    @cached_property
    def friction_nm(self) -> float:
        """Friction torque: half the height of the loop in torque, median over the middle half of the angle, N·m."""
        rising, falling = self.forward.rising_arcmin, self.backward.rising_arcmin
        low, high = max(rising[0], falling[0]), min(rising[-1], falling[-1])
        angle = low + (high - low) * _MIDDLE
        height = np.interp(angle, rising, self.forward.torque_nm) - np.interp(angle, falling, self.backward.torque_nm)
        return max(0.0, _median(height) / 2.0)

    @cached_property
    def exclusion_nm(self) -> tuple[float, float]:
        """Torque after the turn at the negative and at the positive end that no fit sees, for friction reverses there.

        `method.reversal_exclusion` times the friction torque, or half of that times the torque by which the loop shows
        it reversed, whichever is less. Less still where the branch does not leave its turn steeply, and zero where it
        leaves it as it arrived: the friction of that loop does not reverse there. It grows without a step, so no small
        change of a unit makes another fit. N·m.
        """
        return self._excluded(-1), self._excluded(1)

    def _excluded(self, end: int) -> float:
        leaving, arriving = (self.backward, self.forward) if end > 0 else (self.forward, self.backward)
        turn = float(leaving.torque_nm[-1 if end > 0 else 0])
        stretch = min(2.0 * self.friction_nm, self._reversed_nm(leaving, arriving, turn, end))
        inner = turn - end * min(stretch, abs(turn) / 2.0)
        there, before = np.interp((turn, inner), arriving.torque_nm, arriving.angle_arcmin)
        arrived = abs(float(there - before))
        left = abs(_at(leaving, turn) - _at(leaving, inner))
        if not arrived > left:
            return 0.0
        low, high = STEEP
        part = min(max((1.0 - left / arrived - low) / (high - low), 0.0), 1.0)
        return part * self.method.reversal_exclusion / 2.0 * stretch

    def _reversed_nm(self, leaving: Branch, arriving: Branch, turn_nm: float, end: int) -> float:
        """Torque after a turn by which the height of the loop has come to `REVERSED` of what it comes to."""
        deepest = min(self.method.reversal_exclusion * self.friction_nm, abs(turn_nm))
        depth = _DEPTHS * (deepest / (DEPTHS - 1))  # as np.linspace, which takes several times as long
        depth[-1] = deepest
        torque = turn_nm - end * depth
        angle = np.interp(torque, leaving.torque_nm, leaving.angle_arcmin)
        there = np.interp(angle, arriving.rising_arcmin, arriving.torque_nm)
        height = np.maximum.accumulate(end * (there - torque))
        return float(np.interp(REVERSED * height[-1], height, depth))

    @cached_property
    def fit(self) -> SixSegmentFit:
        """Six-segment fit; AnalysisError when the branches are too short for it."""
        method = self.method
        return fit_six_segments(self.forward, self.backward, method.break_nm, method.fit_nm, self.exclusion_nm)

    @cached_property
    def curves(self) -> dict[str, FittedCurves]:
        """Fitted curves by the name of their fit; `analysis.loop.curves` fits each when it is first asked for."""
        return {}

    @property
    def reference_nm(self) -> float:
        """Torque that percentages refer to, N·m."""
        return self.method.reference_nm

    def rising_at(self, torque_nm: float) -> float:
        """f(T) [arcmin], as measured."""
        return _at(self.forward, torque_nm)

    def falling_at(self, torque_nm: float) -> float:
        """r(T) [arcmin], as measured."""
        return _at(self.backward, torque_nm)

    def mean_at(self, torque_nm: float) -> float:
        """m(T) = (f + r) / 2 [arcmin], as measured: next to a turn it has in it what friction does there."""
        return (self.rising_at(torque_nm) + self.falling_at(torque_nm)) / 2.0

    def branch_at(self, branch: str, side: int, torque_nm: float) -> float:
        """Wind-up [arcmin] at a torque >= 0 of one side, turned to that side: "load", "unload" or "mean" branch."""
        if branch == "mean":
            return side * self.mean_at(side * torque_nm)
        rising = (branch == "load") == (side > 0)
        return side * (self.rising_at(side * torque_nm) if rising else self.falling_at(side * torque_nm))

    def loading(self, side: int, torque_nm: FloatArray) -> FloatArray:
        """Wind-up [arcmin] of the loading branch at many torques >= 0 of one side, turned to that side."""
        branch = self.forward if side > 0 else self.backward
        return side * branch.at(side * torque_nm)

    @cached_property
    def energy_nm_arcmin(self) -> float:
        """Area of the loop between its turning points, N·m·arcmin; positive when energy is lost."""
        low = max(float(self.forward.torque_nm[0]), float(self.backward.torque_nm[0]))
        high = min(float(self.forward.torque_nm[-1]), float(self.backward.torque_nm[-1]))
        return _area(self.backward, low, high) - _area(self.forward, low, high)


def _median(values: FloatArray) -> float:
    """Median of an odd number of values; NaN where one of them is: what np.median takes several times as long for."""
    parted = np.partition(values, (values.size // 2, values.size - 1))
    return math.nan if math.isnan(parted[-1]) else float(parted[values.size // 2])


def _at(branch: Branch, torque_nm: float) -> float:
    """Wind-up [arcmin] of a branch at one torque."""
    return branch.value_at(torque_nm)


def _area(branch: Branch, low_nm: float, high_nm: float) -> float:
    """Integral of the wind-up over torque between two torques."""
    first, behind = branch.torque_nm.searchsorted(low_nm, "right"), branch.torque_nm.searchsorted(high_nm, "left")
    at_ends = branch.at(np.array([low_nm, high_nm]))
    torque = np.concatenate(([low_nm], branch.torque_nm[first:behind], [high_nm]))
    angle = np.concatenate((at_ends[:1], branch.angle_arcmin[first:behind], at_ends[1:]))
    return float(np.trapezoid(angle, torque))


def reversal_record(loops: Sequence[Loop]) -> StageRecord:
    """Say how much torque after each turning point is taken from the fit."""
    first = loops[0]
    below, above = first.exclusion_nm
    friction = (
        f"at most {first.method.reversal_exclusion:g} × friction of {first.friction_nm:.3g} N·m where it reverses"
    )
    text = (
        f"reversal: {below:.3g} N·m after the negative and {above:.3g} N·m after the positive turning point are taken "
        f"from the fit ({friction})"
    )
    figures = {
        "friction": Figure(first.friction_nm, "N·m"),
        "excluded after the negative turn": Figure(below, "N·m"),
        "excluded after the positive turn": Figure(above, "N·m"),
    }
    return StageRecord("reversal zones", text, figures, applied=below > 0.0 or above > 0.0)


def fit_record(loops: Sequence[Loop]) -> StageRecord:
    """Say what the six-segment fit of the first cycle found, or why there is none."""
    try:
        fit = loops[0].fit
    except AnalysisError as error:
        return StageRecord("fits", f"fit: none: {error}")
    below, above = fit.mean.gaps_arcmin
    figures = {
        "break torque": Figure(fit.mean.break_nm, "N·m"),
        "gap of the fits at the negative break torque": Figure(below, "arcmin"),
        "gap of the fits at the positive break torque": Figure(above, "arcmin"),
        "rising branch from": Figure(fit.forward_end_nm[0], "N·m"),
        "rising branch to": Figure(fit.forward_end_nm[1], "N·m"),
        "falling branch from": Figure(fit.backward_end_nm[0], "N·m"),
        "falling branch to": Figure(fit.backward_end_nm[1], "N·m"),
    }
    text = (
        f"fit: six segments, linear to ±{fit.mean.break_nm:.4g} N·m and quadratic beyond; seams differ by {below:.2g} "
        f"and {above:.2g} arcmin"
    )
    return StageRecord("fits", text, figures)
