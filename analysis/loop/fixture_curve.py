"""Deflection of a test fixture over torque, as a blank test gives it. Source: "static testing"."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

Angles = Literal["both", "loaded", "given"]
"""What a wind-up is made of: both shafts' angles, the loaded shaft's alone, or a wind-up that came ready made."""


@dataclass(frozen=True)
class FixtureCurve:
    """Deflection [arcmin] over torque [N·m], both rising; zero at zero torque. Beyond its ends it goes on straight.

    angles: what the wind-up was made of when the curve was measured; it corrects a wind-up of the same kind only.
    id: of the blank test. Raises AnalysisError for a curve that is no curve.
    """

    torque_nm: tuple[float, ...]
    deflection_arcmin: tuple[float, ...]
    angles: Angles = "loaded"
    id: str = ""

    def __post_init__(self) -> None:
        """Refuse torques that do not rise and deflections that fall."""
        torque, deflection = np.asarray(self.torque_nm), np.asarray(self.deflection_arcmin)
        if torque.size < 2 or torque.size != deflection.size:
            raise AnalysisError(
                f"fixture curve: found {torque.size} torques and {deflection.size} deflections; expected 2 pairs or "
                "more"
            )
        if not (np.isfinite(torque).all() and np.isfinite(deflection).all()):
            raise AnalysisError("fixture curve: found a value that is not finite; measure the fixture again")
        if not (np.diff(torque) > 0).all() or not (np.diff(deflection) >= 0).all():
            raise AnalysisError(
                "fixture curve: expected torques that rise and deflections that do not fall; sort the points, or "
                "make the curve from a blank test"
            )

    def at(self, torque_nm: FloatArray) -> FloatArray:
        """Deflection [arcmin] at torques [N·m]."""
        x, y = np.asarray(self.torque_nm), np.asarray(self.deflection_arcmin)
        found = np.interp(torque_nm, x, y)
        for end, inner, beyond in ((0, 1, torque_nm < x[0]), (-1, -2, torque_nm > x[-1])):
            if beyond.any():
                slope = (y[end] - y[inner]) / (x[end] - x[inner])
                found = np.where(beyond, y[end] + slope * (torque_nm - x[end]), found)
        return np.asarray(found, dtype=np.float64)

    def stiffness_at(self, torque_nm: float) -> float:
        """Stiffness K_fixture(T) = T / deflection [N·m/arcmin]; infinite where nothing deflects."""
        deflection = float(self.at(np.array([torque_nm]))[0])
        return torque_nm / deflection if deflection else math.inf
