"""One cycle of the hysteresis loop: both branches, their friction, the zones next to the turning points, and the fit.

Words: forward is the branch of rising torque, return the one of falling torque. On the positive side the loading
branch is forward and the unloading branch is return; on the negative side it is the other way round.
"""

from __future__ import annotations

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

STEEP = 3.0
"""A branch leaves its turn steeply when it is this much stiffer than the one that arrived, over twice the friction."""

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
        rising = np.maximum.accumulate(self.forward.angle_arcmin)
        falling = np.maximum.accumulate(self.backward.angle_arcmin)
        low, high = max(rising[0], falling[0]), min(rising[-1], falling[-1])
        angle = low + (high - low) * np.linspace(*MIDDLE_OF_LOOP, 501)
        height = np.interp(angle, rising, self.forward.torque_nm) - np.interp(angle, falling, self.backward.torque_nm)
        return max(0.0, float(np.median(height)) / 2.0)

    @cached_property
    def exclusion_nm(self) -> tuple[float, float]:
        """Torque in which friction still reverses after the turn at the negative and at the positive end, N·m.

        Zero where the branch does not leave the turn steeply: the friction of that loop does not reverse there.
        """
        return self._excluded(-1), self._excluded(1)

    def _excluded(self, end: int) -> float:
        leaving, arriving = (self.backward, self.forward) if end > 0 else (self.forward, self.backward)
        turn = float(leaving.torque_nm[-1 if end > 0 else 0])
        span = min(2.0 * self.friction_nm, abs(turn) / 2.0)
        inner = turn - end * span
        arrived = abs(float(np.interp(turn, arriving.torque_nm, arriving.angle_arcmin)
                            - np.interp(inner, arriving.torque_nm, arriving.angle_arcmin)))  # fmt: skip
        left = abs(self._measured(leaving, turn) - self._measured(leaving, inner))
        return self.method.reversal_exclusion * self.friction_nm if arrived > STEEP * left else 0.0

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
        """f(T) [arcmin]; next to the turning point that the branch starts from, its fitted segment instead."""
        if torque_nm < float(self.forward.torque_nm[0]) + self.exclusion_nm[0] and torque_nm < 0.0:
            return self._fitted(torque_nm, self.fit.forward[0])
        return self._measured(self.forward, torque_nm)

    def falling_at(self, torque_nm: float) -> float:
        """r(T) [arcmin]; next to the turning point that the branch starts from, its fitted segment instead."""
        if torque_nm > float(self.backward.torque_nm[-1]) - self.exclusion_nm[1] and torque_nm > 0.0:
            return self._fitted(torque_nm, self.fit.backward[2])
        return self._measured(self.backward, torque_nm)

    def mean_at(self, torque_nm: float) -> float:
        """m(T) = (f + r) / 2 [arcmin]."""
        return (self.rising_at(torque_nm) + self.falling_at(torque_nm)) / 2.0

    def raw_mean_at(self, torque_nm: float) -> float:
        """m(T) [arcmin] of the branches as measured, next to the turning points too."""
        return (self._measured(self.forward, torque_nm) + self._measured(self.backward, torque_nm)) / 2.0

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

    def _measured(self, branch: Branch, torque_nm: float) -> float:
        return float(branch.at(np.array([torque_nm]))[0])

    def _fitted(self, torque_nm: float, segment: FloatArray) -> float:
        if not self.method.break_nm <= abs(torque_nm) <= 1.05 * self.method.fit_nm:
            raise AnalysisError(
                f"at {torque_nm:.4g} N·m friction is still reversing ({max(self.exclusion_nm):.3g} N·m next to the "
                "turning point are excluded); load the unit further beyond the torques that are evaluated"
            )
        return float(np.polynomial.polynomial.polyval(torque_nm, segment))


def _area(branch: Branch, low_nm: float, high_nm: float) -> float:
    """Integral of the wind-up over torque between two torques."""
    inside = (branch.torque_nm > low_nm) & (branch.torque_nm < high_nm)
    torque = np.concatenate(([low_nm], branch.torque_nm[inside], [high_nm]))
    return float(np.trapezoid(branch.at(torque), torque))


def reversal_record(loops: Sequence[Loop]) -> StageRecord:
    """Say how much torque after each turning point is taken from the fit."""
    first = loops[0]
    below, above = first.exclusion_nm
    friction = f"{first.method.reversal_exclusion:g} × friction of {first.friction_nm:.3g} N·m where it reverses"
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
        "gap at the negative seam": Figure(below, "arcmin"),
        "gap at the positive seam": Figure(above, "arcmin"),
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
