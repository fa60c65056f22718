"""Deflection of a test fixture over torque, and stiffnesses in series.

Sources: "static testing" and "inverse loading test system" (1/K_r = 1/K + 1/K_1 + 1/(K_i i²)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from analysis.errors import AnalysisError
from analysis.units import FloatArray

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
                f"fixture curve: found {torque.size} torques and {deflection.size} deflections; needed are 2 pairs or "
                "more"
            )
        if not (np.isfinite(torque).all() and np.isfinite(deflection).all()):
            raise AnalysisError("fixture curve: found a value that is not finite; measure the fixture again")
        if not (np.diff(torque) > 0).all() or not (np.diff(deflection) >= 0).all():
            raise AnalysisError(
                "fixture curve: needed are torques that rise and deflections that do not fall; sort the points, or "
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


def reducer_stiffness(
    measured: float, fixture: float = math.inf, at_input: float = math.inf, ratio: float = 1.0
) -> float:
    """Stiffness K of the reducer alone from the measured one K_r: 1/K_r = 1/K + 1/K_1 + 1/(K_i i²).

    measured K_r, fixture K_1 at the output, at_input K_i of coupling and sensor at the input: the same unit, any.
    ratio i. Raises AnalysisError when the parts alone are softer than what was measured, or a stiffness is not above 0.
    """
    for name, value in (("measured", measured), ("fixture", fixture), ("at_input", at_input), ("ratio", ratio)):
        if not value > 0:
            raise AnalysisError(f"stiffnesses in series: {name}: found {value:g}; needed is a number above zero")
    compliance = 1.0 / measured - 1.0 / fixture - 1.0 / (at_input * ratio * ratio)
    if compliance <= 0:
        raise AnalysisError(
            f"stiffnesses in series: fixture and input part together are as soft as the measured {measured:g}: nothing "
            "is left for the reducer; measure the fixture again"
        )
    return 1.0 / compliance


def series_stiffness(
    reducer: float, fixture: float = math.inf, at_input: float = math.inf, ratio: float = 1.0
) -> float:
    """Stiffness K_r that is measured with a reducer K in series with its fixture: 1/K_r = 1/K + 1/K_1 + 1/(K_i i²)."""
    for name, value in (("reducer", reducer), ("fixture", fixture), ("at_input", at_input), ("ratio", ratio)):
        if not value > 0:
            raise AnalysisError(f"stiffnesses in series: {name}: found {value:g}; needed is a number above zero")
    return 1.0 / (1.0 / reducer + 1.0 / fixture + 1.0 / (at_input * ratio * ratio))
