"""One stop of the motor: speed to zero on a ramp, then torque to zero on the torque slope.

In torque modes only the second part: the torque slope unwinds a reducer under control, where a speed ramp would hold
it wound up and then let go of it at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from virtual_bench.physics.plant_numbers import DriveLoop

STOPPED_TORQUE_PERMILLE = 10  # of rated torque: below this a torque ramp is done
STOPPED_SPEED_FRACTION = 1e-3  # of a turn per second, likewise for a speed ramp
LIMIT_NS = 2_000_000_000  # a stop that has not ended by then is cut


@dataclass(slots=True)
class MotorView:
    """What the drive measures at its motor; written in place with each look."""

    torque_permille: int = 0
    position_counts: int = 0  # since power-on, before the home offset
    velocity_counts_s: int = 0
    limited: bool = False  # a torque or speed limit has acted lately


class Demand(NamedTuple):
    """What the drive's loops are to do."""

    loop: DriveLoop
    torque_permille: int
    velocity_counts_s: float


MOTOR_OFF = Demand(DriveLoop.OFF, 0, 0.0)
NO_TORQUE = Demand(DriveLoop.TORQUE, 0, 0.0)
STANDSTILL = Demand(DriveLoop.VELOCITY, 0, 0.0)


demand_of = partial(tuple.__new__, Demand)


class MotorStop:
    """A stop that began at `now_ns` from the motor's present speed."""

    def __init__(self, motor: MotorView, ramp_counts_s2: float, counts_per_rev: float, now_ns: int) -> None:
        self._ramp = ramp_counts_s2
        self._slow = STOPPED_SPEED_FRACTION * counts_per_rev
        self._velocity = float(motor.velocity_counts_s)
        self._by_torque = False
        self._started_ns = self._last_ns = now_ns

    @classmethod
    def of_torque(cls, motor: MotorView, now_ns: int) -> MotorStop:
        """Return a stop that only takes the torque away."""
        stop = cls(motor, 0.0, 0.0, now_ns)
        stop._by_torque = True
        return stop

    @property
    def demand(self) -> Demand:
        """What the loops are to do now."""
        return NO_TORQUE if self._by_torque else Demand(DriveLoop.VELOCITY, 0, self._velocity)

    def overdue(self, now_ns: int) -> bool:
        """Return whether the stop has taken longer than it may."""
        return now_ns - self._started_ns > LIMIT_NS

    def carry_on(self, motor: MotorView, now_ns: int) -> bool:
        """Move the ramp on to `now_ns` and return whether the motor has stopped and is free of torque."""
        if self._by_torque:
            return abs(motor.torque_permille) <= STOPPED_TORQUE_PERMILLE
        left = max(abs(self._velocity) - self._ramp * (now_ns - self._last_ns) * 1e-9, 0.0)
        self._last_ns = now_ns
        self._velocity = left if self._velocity > 0.0 else -left
        self._by_torque = left == 0.0 and abs(motor.velocity_counts_s) < self._slow
        return False
