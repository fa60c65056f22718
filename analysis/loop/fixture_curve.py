"""How far a test fixture gives way: by the stiffness of its parts, and over torque as a blank test gives it.

Sources: of the parts "inverse loading test system" and "stiffness characterization", 2; of the test "static testing".
"""

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
            raise AnalysisError("fixture curve: a torque or deflection is not a number. Measure the fixture again")
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


def fixture_stiffness(output_side: float, input_side: float, ratio: float) -> float:
    """Stiffness of a fixture at the output, 1/K = 1/K_1 + 1/(K_i i²), all in one unit.

    output_side: K_1, of shaft and connections at the output; input_side: K_i, of shaft, coupling and lock at the input,
    as it is there.
    """
    return series_stiffness(output_side, stiffness_at_output(input_side, ratio))


def series_stiffness(*stiffnesses: float) -> float:
    """Stiffness of springs behind one another, all referred to one shaft and in one unit: 1/K = Σ 1/K_n."""
    compliance = sum(1.0 / _stiffness(one) for one in stiffnesses)
    return 1.0 / compliance if compliance else math.inf


def stiffness_at_output(stiffness_at_input: float, ratio: float) -> float:
    """Stiffness seen at the output of a spring at the input: i² times, in the same unit."""
    return _stiffness(stiffness_at_input) * _above_zero(ratio, "ratio") ** 2


def compensated_stiffness(measured: float, output_side: float, input_side: float, ratio: float) -> float:
    """Stiffness of the unit alone, 1/K = 1/K_r − 1/K_1 − 1/(K_i i²), all in one unit.

    measured: K_r, of unit and fixture together; the others as in `fixture_stiffness`, infinite for a side that does not
    give way. AnalysisError when the fixture alone is as soft as what was measured. It holds for a stiffness alone, as
    one of a data sheet: for lost motion the angle trace is corrected (`fixture.parts` of a bench file).
    """
    fixture = fixture_stiffness(output_side, input_side, ratio)
    left = 1.0 / _above_zero(measured, "measured stiffness") - 1.0 / fixture
    if left <= 0.0:
        raise AnalysisError(
            f"measured stiffness: found {measured:g}, and the fixture alone has {fixture:g}; expected less than that: "
            "check the fixture's stiffness"
        )
    return 1.0 / left


def _stiffness(value: float) -> float:
    """Return a stiffness; infinite is one that does not give way."""
    return value if value == math.inf else _above_zero(value, "stiffness")


def _above_zero(value: float, what: str) -> float:
    if not (math.isfinite(value) and value > 0.0):
        raise AnalysisError(f"{what}: found {value}; expected a number above zero")
    return value
