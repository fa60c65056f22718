"""Elastic torque over wind-up: compliance that stiffens, with a gap; and its cubic approximation."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from analysis.trace.units import FloatArray

TABLE_POINTS = 400
"""Torques at which the compliance is tabulated before Newton's steps polish its inverse."""

NEWTON_STEPS = 4
"""From a table of 400 points two reach the rounding of a float; the others cost little."""


class Compliance(NamedTuple):
    """Wind-up over torque: φ = T/K_inf + b·sgn(T)(1 − exp(−|T|/T0)) + (j/2)·tanh(T/T_j); all above zero.

    stiffness_nm_per_arcmin K_inf at high torque, soft_zone_arcmin b and soft_zone_nm T0 of the contacts that stiffen,
    gap_arcmin j and gap_torque_nm T_j of the play.
    """

    stiffness_nm_per_arcmin: float
    soft_zone_arcmin: float
    soft_zone_nm: float
    gap_arcmin: float
    gap_torque_nm: float

    def angle_arcmin(self, torque_nm: FloatArray) -> FloatArray:
        """Wind-up [arcmin] at torques [N·m]."""
        size = np.abs(torque_nm)
        angle: FloatArray = np.sign(torque_nm) * (
            size / self.stiffness_nm_per_arcmin
            - self.soft_zone_arcmin * np.expm1(-size / self.soft_zone_nm)
            + 0.5 * self.gap_arcmin * np.tanh(size / self.gap_torque_nm)
        )
        return angle

    def compliance(self, torque_nm: FloatArray) -> FloatArray:
        """Return dφ/dT [arcmin/(N·m)] at torques [N·m]."""
        size = np.abs(torque_nm)
        slope: FloatArray = (
            1.0 / self.stiffness_nm_per_arcmin
            + self.soft_zone_arcmin / self.soft_zone_nm * np.exp(-size / self.soft_zone_nm)
            + 0.5 * self.gap_arcmin / self.gap_torque_nm * (1.0 - np.tanh(size / self.gap_torque_nm) ** 2)
        )
        return slope

    def torque_nm(self, angle_arcmin: FloatArray) -> FloatArray:
        """Torque [N·m] at wind-ups [arcmin]: the inverse, tabulated and polished by Newton's method."""
        wanted = np.abs(angle_arcmin)
        # φ ≥ T/K_inf, so the torque cannot be higher than this
        most = self.stiffness_nm_per_arcmin * float(wanted.max(initial=0.0)) * 1.01 + 1e-9
        scale = min(self.gap_torque_nm, self.soft_zone_nm, most)
        nodes = scale * np.sinh(np.linspace(0.0, math.asinh(most / scale), TABLE_POINTS))
        torque = np.interp(wanted, self.angle_arcmin(nodes), nodes)
        for _ in range(NEWTON_STEPS):
            torque = np.maximum(torque - (self.angle_arcmin(torque) - wanted) / self.compliance(torque), 0.0)
        result: FloatArray = np.copysign(torque, angle_arcmin)
        return result


def cubic_torque_nm(linear: float, cubic: float, angle_arcmin: FloatArray) -> FloatArray:
    """Torque [N·m] T = a₁ θ + a₃ θ³ with a₁ in N·m/arcmin and a₃ in N·m/arcmin³ ("stiffness characterization" 5)."""
    torque: FloatArray = linear * angle_arcmin + cubic * angle_arcmin**3
    return torque
