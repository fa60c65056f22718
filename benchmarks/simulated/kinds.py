"""Reducers that share nothing with the virtual bench or with the analysis: their branches in closed form.

The torque at the output drives a generalised Prandtl–Ishlinskii operator: many plays in parallel, of different
thresholds that grow with the load. Its output loads an arctangent gap, Hertz contact (angle ∝ torque^⅔) and a straight
spring.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

PLAYS = 24
ROWS_AT_ONCE = 2000


@dataclass(frozen=True)
class Kind:
    """A type of reducer. Torques are shares of the rated torque at the output, angles arcmin at the output.

    threshold: least and largest friction threshold of the plays; the torque must turn back by twice that before the
    angle follows wholly. yields: least and largest angle over which friction at the input reverses, halved.
    """

    name: str
    ratio: float
    rated_nm: float
    spring_nm_per_arcmin: float
    gap_arcmin: float
    hertz_arcmin: float
    threshold: tuple[float, float] = (0.01, 0.05)
    threshold_grows: float = 0.2
    gap_torque: float = 0.006
    negative_angle: float = 1.0
    input_friction: float = 0.034
    input_friction_grows: float = 0.27
    yields: tuple[float, float] = (0.002, 0.06)

    def varied(self, random: np.random.Generator, spread: float = 0.15) -> Kind:
        """Return another unit of this type."""
        names = ("spring_nm_per_arcmin", "gap_arcmin", "hertz_arcmin", "threshold_grows", "gap_torque",
                 "input_friction", "input_friction_grows")  # fmt: skip
        moved = {name: getattr(self, name) * (1.0 + spread * random.uniform(-1.0, 1.0)) for name in names}
        low, high = self.threshold
        wider = 1.0 + spread * random.uniform(-1.0, 1.0)
        return replace(self, **moved, threshold=(low, high * wider))

    @property
    def thresholds_nm(self) -> np.ndarray:
        """Threshold of each play without load, N·m."""
        return np.linspace(*self.threshold, PLAYS) * self.rated_nm

    def elastic(self, torque_nm: np.ndarray | float) -> np.ndarray:
        """Angle [arcmin] of gap, contacts and spring under a torque that no friction takes from."""
        torque = np.asarray(torque_nm, dtype=np.float64)
        share = np.abs(torque) / self.rated_nm
        # by logarithms: a power takes four times as long
        contact = np.copysign(np.exp(np.log(share + 1e-3) * (2.0 / 3.0)) - 1e-2, torque)
        gap = np.arctan(torque / (self.gap_torque * self.rated_nm)) / math.pi
        angle = self.gap_arcmin * gap + self.hertz_arcmin * contact + torque / self.spring_nm_per_arcmin
        return angle if self.negative_angle == 1.0 else np.where(torque < 0.0, self.negative_angle * angle, angle)

    def mean_angle(self, plays: np.ndarray) -> np.ndarray:
        """Mean angle [arcmin] of all plays, a row each time; so many rows at a time as stay near the processor."""
        pieces = [plays[first : first + ROWS_AT_ONCE] for first in range(0, len(plays), ROWS_AT_ONCE)]
        return np.concatenate([np.asarray(self.elastic(piece)).mean(axis=1) for piece in pieces])

    def _reach(self, torque_nm: np.ndarray, direction: int) -> np.ndarray:
        """Where each play is when it is dragged along: a column per play."""
        torque = np.atleast_1d(torque_nm)[:, None]
        drag = self.thresholds_nm * (1.0 + self.threshold_grows * np.abs(torque) / self.rated_nm)
        return torque - direction * drag

    def moved(self, plays: np.ndarray, torque_nm: np.ndarray, direction: int) -> np.ndarray:
        """Return each play along a torque of one direction; plays: where they are before it."""
        reach = self._reach(torque_nm, direction)
        return np.maximum(plays, reach) if direction > 0 else np.minimum(plays, reach)

    def angle(self, torque_nm: np.ndarray | float, direction: int, peak_nm: float) -> np.ndarray:
        """Angle [arcmin] on a branch of the closed loop between ±peak: the truth."""
        turn = self._reach(np.array([-direction * peak_nm]), -direction)[0]
        along = self.moved(turn, np.atleast_1d(np.asarray(torque_nm, dtype=np.float64)), direction)
        return self.mean_angle(along)


KINDS = {
    kind.name: kind
    for kind in (
        Kind("RV-20E", 105.0, 167.0, 58.0, 0.35, 0.55),
        Kind("RV-40E", 121.0, 412.0, 125.0, 0.3, 0.6),
        Kind("RV-320E", 129.0, 3136.0, 1150.0, 0.25, 0.5),
        Kind("RV-50", 121.0, 50.0, 33.0, 0.5, 0.4, threshold=(0.01, 0.04), gap_torque=0.02),
        Kind("strain-wave", 100.0, 67.0, 12.0, 0.1, 1.6, threshold=(0.02, 0.25), gap_torque=0.05,
             input_friction=0.05, input_friction_grows=0.35, yields=(0.01, 0.4)),
        Kind("asymmetric", 121.0, 412.0, 125.0, 0.4, 0.6, negative_angle=1.25),
    )
}  # fmt: skip
"""Types of units by name. Scales are those of their catalogues; stiffness_of says what they come to."""


def width(unit: Kind, torque_nm: float, peak_nm: float) -> float:
    """Loop width at a torque [arcmin]: return less forward branch."""
    return float(unit.angle(torque_nm, -1, peak_nm)[0] - unit.angle(torque_nm, 1, peak_nm)[0])


def mean(unit: Kind, torque_nm: float, peak_nm: float) -> float:
    """Mean of both branches at a torque [arcmin]."""
    return float(unit.angle(torque_nm, -1, peak_nm)[0] + unit.angle(torque_nm, 1, peak_nm)[0]) / 2.0
