"""A reducer in closed form, for studies: elastic wind-up, Dahl hysteresis, input friction. No time steps.

Quasi-static: T = g(φ) + F_h with φ = T/K + b·sgn(T)(1 − exp(−|T|/T0)) + (j/2)·tanh(T/T_j) as the inverse of g, and on a
monotone branch F = s·F_c + (F0 − s·F_c)·exp(−sigma·|Δφ|/F_c). φ is larger by half the side difference on the negative
side and smaller on the positive one. The input torque sensor feels the
friction of the input side.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from analysis.trace.units import FloatArray
from definitions.units import RAD_PER_ARCMIN

CURVE_POINTS = 20_001
"""Points of a branch: 0.05 N·m apart, and nearer where the branch turns."""


SIDES = 0.05
"""How far the two sides of a real unit differ in their wind-up: some per cent."""


@dataclass(frozen=True)
class SimulatedUnit:
    """Parameters of one unit; torques [N·m] and angles [arcmin] at the output. The defaults are an RV-40E-121.

    Its sides are alike. It has a loop width of 0.94 arcmin and 115 N·m/arcmin at its rated torque of 412 N·m.
    friction_loading and friction_unloading: input friction at zero load, N·m at the input; the fractions are of the
    torque that arrives.
    """

    stiffness_nm_per_arcmin: float = 110.86950329
    soft_arcmin: float = 0.7789045
    soft_torque_nm: float = 100.0
    gap_arcmin: float = 0.2
    gap_torque_nm: float = 2.0
    hysteresis_nm: float = 23.47536281
    hysteresis_stiffness_nm_per_arcmin: float = 2000.0
    friction_loading_nm: float = 13.889 / 94.689
    friction_unloading_nm: float = 13.889 / 94.689
    friction_loading_fraction: float = 121.0 / 94.689 - 1.0
    friction_unloading_fraction: float = 121.0 / 94.689 - 1.0
    bristle_nm: float = 30.0
    """Torque at which the input friction deflects one arcmin of output before it slides."""
    side_difference: float = 0.0
    """By how much more the negative side winds up than the positive one, elastically, as a fraction of their mean."""

    def varied(self, random: np.random.Generator, spread: float = 0.2, sides: float = SIDES) -> SimulatedUnit:
        """Return another unit: every parameter moved by a factor within 1 ± spread, its sides apart within ± sides."""
        moved = {one.name: getattr(self, one.name) * random.uniform(1 - spread, 1 + spread)
                 for one in fields(self) if one.name != "side_difference"}  # fmt: skip
        return replace(self, **moved, side_difference=random.uniform(-sides, sides))

    def elastic_arcmin(self, torque_nm: FloatArray) -> FloatArray:
        """Wind-up without hysteresis [arcmin] over torque [N·m]."""
        magnitude = np.abs(torque_nm)
        soft = self.soft_arcmin * np.sign(torque_nm) * -np.expm1(-magnitude / self.soft_torque_nm)
        windup = (
            torque_nm / self.stiffness_nm_per_arcmin
            + soft
            + self.gap_arcmin / 2.0 * np.tanh(torque_nm / self.gap_torque_nm)
        )
        sided: FloatArray = windup * (1.0 - self.side_difference / 2.0 * np.sign(torque_nm))
        return sided

    def loop(self, peak_nm: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Wind-up [arcmin], torque rising and torque falling along it [N·m], of the closed loop to ±peak."""
        friction = self.hysteresis_nm
        elastic = np.linspace(-(peak_nm - friction), peak_nm - friction, CURVE_POINTS)
        windup = self.elastic_arcmin(elastic)
        decay = self.hysteresis_stiffness_nm_per_arcmin / friction
        rising = elastic + friction - 2.0 * friction * np.exp(-decay * (windup - windup[0]))
        falling = elastic - friction + 2.0 * friction * np.exp(-decay * (windup[-1] - windup))
        return windup, rising, falling

    def virgin(self, peak_nm: float) -> tuple[FloatArray, FloatArray]:
        """Wind-up [arcmin] and torque [N·m] of the first loading from nothing."""
        elastic = np.linspace(0.0, peak_nm - self.hysteresis_nm, CURVE_POINTS)
        windup = self.elastic_arcmin(elastic)
        decay = self.hysteresis_stiffness_nm_per_arcmin / self.hysteresis_nm
        return windup, elastic - self.hysteresis_nm * np.expm1(-decay * windup)

    def input_torque(self, turned_rad: FloatArray, torque_nm: FloatArray, ratio: float) -> FloatArray:
        """Torque that the input sensor feels [N·m] along angles of the input shaft and torques at the output.

        Presliding: the friction approaches its level exponentially with the angle turned. The level depends on whether
        the motion loads or unloads.
        """
        steps = np.diff(turned_rad, prepend=turned_rad[0])
        loads = steps * torque_nm > 0.0
        arriving = np.abs(torque_nm) / ratio
        level = np.where(
            loads,
            self.friction_loading_nm + self.friction_loading_fraction * arriving,
            self.friction_unloading_nm + self.friction_unloading_fraction * arriving,
        )
        keep = np.exp(-self.bristle_nm / (ratio * RAD_PER_ARCMIN) * np.abs(steps) / level)
        friction = 0.0
        found: list[float] = []
        for sliding, kept in zip((np.sign(steps) * level).tolist(), keep.tolist(), strict=True):
            friction = sliding + (friction - sliding) * kept
            found.append(friction)
        felt: FloatArray = torque_nm / ratio + np.array(found)
        return felt


def shaft_angle_rad(windup_arcmin: FloatArray, ratio: float) -> FloatArray:
    """Angle of the input shaft [rad] that winds the output up by so many arcmin."""
    return windup_arcmin * (ratio * RAD_PER_ARCMIN)
