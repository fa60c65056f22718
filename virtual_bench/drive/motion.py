"""What the virtual drive asks of its motor: mode of operation, targets, homing, halt and stop, and the demand of them.

Of the power state it knows two things: whether the motor may have torque, and whether operation is enabled. The demand
is made anew with every change, not with every look at it.
"""

from __future__ import annotations

from virtual_bench.drive import cia402_tables as tables
from virtual_bench.drive.cia402_tables import Mode, Stop
from virtual_bench.drive.settings import DriveObjects
from virtual_bench.physics.motor_stop import MOTOR_OFF, NO_TORQUE, STANDSTILL, MotorStop, MotorView, demand_of
from virtual_bench.physics.plant_numbers import DriveLoop

HOMING_STANDSTILL_FRACTION = 0.02  # of a turn per second: faster than this the reference is refused

# Asked in every scan: a member looked up by its class costs twenty times as much.
_TORQUE, _VELOCITY, _NO_MODE = Mode.CYCLIC_SYNC_TORQUE, Mode.CYCLIC_SYNC_VELOCITY, Mode.NONE
_TORQUE_LOOP, _VELOCITY_LOOP = DriveLoop.TORQUE, DriveLoop.VELOCITY


class DriveMotion:
    """The motor's orders as the network and the power state leave them."""

    def __init__(self, objects: DriveObjects, counts_per_rev: float) -> None:
        self.demand = MOTOR_OFF
        self.following = False
        """Whether targets act: operation is enabled, and neither a stop nor a halt is under way."""
        self.mode = 0
        """Mode of operation 0x6060 as last received."""
        self.mode_display = Mode.NONE
        self.target_torque = 0
        """Target torque 0x6071 as last received."""
        self.target_velocity = 0
        """Target velocity 0x60FF as last received."""
        self.home_counts = 0
        self.homing_attained = False
        self.homing_error = False
        self.stop: MotorStop | None = None
        self.ramp: MotorStop | None = None
        """The stop or halt that is under way; the stop where there are both."""
        self._objects = objects
        self._counts_per_rev = counts_per_rev
        self._energized = False
        self._enabled = False
        self._halt: MotorStop | None = None

    # What comes from the network -------------------------------------------------------------------------------

    def write_mode(self, value: int) -> None:
        """Take a mode of operation; one that the drive does not have leaves the display as it was."""
        if value == self.mode:
            return
        self.mode = value
        if value in Mode.__members__.values():
            self.mode_display = Mode(value)
            self.homing_attained = self.homing_error = False
            self._update_demand()

    def write_target_torque(self, permille: int) -> None:
        """Take a target torque in 0.1 % of rated torque."""
        if permille != self.target_torque:
            self.target_torque = permille
            self._update_demand()

    def write_target_velocity(self, counts_s: int) -> None:
        """Take a target velocity."""
        if counts_s != self.target_velocity:
            self.target_velocity = counts_s
            self._update_demand()

    # What comes from the power state machine -------------------------------------------------------------------

    def enter(self, *, energized: bool, enabled: bool) -> None:
        """Follow the power state into another one, which ends a stop, and a halt unless operation is enabled."""
        self._energized = energized
        self._enabled = enabled
        self.stop = None
        if not enabled:
            self._halt = None
        self._update_demand()

    def begin_stop(self, stop: Stop, motor: MotorView, now_ns: int) -> None:
        """Begin to stop the motor on a ramp."""
        self.stop = self._ramp(stop, motor, now_ns)
        self._update_demand()

    def begin_halt(self, stop: Stop, motor: MotorView, now_ns: int) -> None:
        """Begin a halt, which lasts until `end_halt`; one under way goes on."""
        if self._halt is None:
            self._halt = self._ramp(stop, motor, now_ns)
            self._update_demand()

    def end_halt(self) -> None:
        """Let targets act again."""
        if self._halt is not None:
            self._halt = None
            self._update_demand()

    def carry_on(self, motor: MotorView, now_ns: int) -> bool:
        """Move the ramps of halt and stop on; True when a stop has ended: the motor stands and is free of torque."""
        if self._halt is not None:
            self._halt.carry_on(motor, now_ns)
        stopped = self.stop is not None and self.stop.carry_on(motor, now_ns)
        self._update_demand()
        return stopped

    def home(self, motor: MotorView) -> bool:
        """Take the present position as the reference, while operation is enabled; False when it is refused."""
        self.homing_attained = self.homing_error = False
        if not self._enabled:
            return True
        moving = abs(motor.velocity_counts_s) > HOMING_STANDSTILL_FRACTION * self._counts_per_rev
        if moving or self._objects.homing_method not in tables.HOMING_METHODS:
            self.homing_error = True
            return False
        self.home_counts = motor.position_counts - self._objects.home_offset_counts
        self.homing_attained = True
        return True

    # How it works ----------------------------------------------------------------------------------------------

    def _ramp(self, stop: Stop, motor: MotorView, now_ns: int) -> MotorStop:
        if self.mode_display not in (Mode.CYCLIC_SYNC_VELOCITY, Mode.HOMING):
            return MotorStop.of_torque(motor, now_ns)
        objects = self._objects
        ramp = objects.quick_stop_counts_s2 if stop is Stop.QUICK_RAMP else objects.slow_down_counts_s2
        return MotorStop(motor, ramp, self._counts_per_rev, now_ns)

    def _update_demand(self) -> None:
        self.ramp = ramp = self.stop or self._halt
        self.following = following = self._enabled and ramp is None
        mode = self.mode_display
        if not self._energized:
            self.demand = MOTOR_OFF
        elif ramp is not None:
            self.demand = ramp.demand
        elif mode is _TORQUE and following:
            self.demand = demand_of((_TORQUE_LOOP, self.target_torque, 0.0))
        elif mode is _TORQUE or mode is _NO_MODE:
            self.demand = NO_TORQUE
        elif mode is _VELOCITY and following:
            self.demand = demand_of((_VELOCITY_LOOP, 0, float(self.target_velocity)))
        else:
            self.demand = STANDSTILL
