"""Holds every order of a run against the limits of its recipe and bench, whatever the devices have said."""

from __future__ import annotations

import math

from controller.aftermath import FaultReaction, Release
from controller.loading import Loading
from controller.states import TRANSITIONS
from definitions.image import Command, DriveCommand, DriveMode, Image, Orders, Reaction, State
from definitions.program import Program

ENABLING = (DriveCommand.ENABLE_OPERATION, DriveCommand.START_HOMING)
TOWARDS_TORQUE = (DriveCommand.SWITCH_ON, *ENABLING)
EPSILON = 1e-9
FOLLOWING: dict[State, set[State]] = {}
for _row in TRANSITIONS:
    FOLLOWING.setdefault(_row.source, set()).add(_row.dest)


class OrdersWatch:
    """Remembers the last orders; `look` raises AssertionError when an order must not be."""

    def __init__(self, program: Program, orders: Orders, state: State) -> None:
        control = program.control
        self.torque_nm = control.torque_limit_nm
        self.step_nm = control.slew_nm_s * program.period_s
        self.speed = max(segment.speed_rad_s for segment in program.segments)
        self.speed_step = max(segment.acceleration_rad_s2 for segment in program.segments) * program.period_s
        proof_nm = max(abs(s.target_nm) for s in program.segments if s.state == State.LOCK)
        self.proof_nm = Loading.PROOF_MARGIN * (proof_nm + abs(control.offset_nm)) / control.slope
        self.brake_a = program.lock.current_a
        self.last = orders
        self.state = state
        self.acknowledged = self.reset_asked = state != State.FAULT
        self.states: dict[str, int] = {}

    def look(self, image: Image, orders: Orders) -> None:
        """Hold the orders of one scan against the limits and against the scan before."""
        last, now, was = self.last, State(orders.state), self.state
        torque_nm, speed = orders.drive_target_torque_nm, orders.drive_target_velocity_rad_s
        assert all(map(math.isfinite, orders)), orders
        assert now == was or now in FOLLOWING[was], f"{was.name} -> {now.name}"
        assert abs(torque_nm) <= self.torque_nm + EPSILON, f"{torque_nm} N·m ordered, at most {self.torque_nm}"
        assert abs(speed) <= self.speed + EPSILON, f"{speed} rad/s ordered, at most {self.speed}"
        assert orders.brake_current_a in (0.0, self.brake_a), f"{orders.brake_current_a} A ordered"
        if now == State.LOCK:
            assert abs(torque_nm) <= self.proof_nm + EPSILON, f"{torque_nm} N·m before the lock is proven"
        if orders.drive_command in ENABLING and (torque_nm or speed):
            assert orders.brake_on, f"torque or speed in {now.name} with the lock open"
        self._steps(last, orders)
        if last.brake_on and not orders.brake_on:
            assert (was, orders.phase) == (State.RELEASE, Release.OPEN), f"lock opened in {was.name}"
        self._fault(image, orders, was)
        self.states[now.name.lower()] = self.states.get(now.name.lower(), 0) + 1
        self.last, self.state = orders, now

    def _steps(self, last: Orders, orders: Orders) -> None:
        if orders.drive_command not in ENABLING or last.drive_command not in ENABLING:
            return
        if orders.drive_mode == last.drive_mode == DriveMode.CYCLIC_SYNC_TORQUE:
            step_nm = abs(orders.drive_target_torque_nm - last.drive_target_torque_nm)
            assert step_nm <= self.step_nm + EPSILON, f"torque steps by {step_nm} N·m, at most {self.step_nm}"
        if orders.drive_mode == last.drive_mode == DriveMode.CYCLIC_SYNC_VELOCITY:
            faster = abs(orders.drive_target_velocity_rad_s) - abs(last.drive_target_velocity_rad_s)
            assert faster <= self.speed_step + EPSILON, f"speed steps by {faster} rad/s, at most {self.speed_step}"

    def _fault(self, image: Image, orders: Orders, was: State) -> None:
        if was == State.FAULT:
            if orders.state == State.FAULT and orders.alarms & ~self.last.alarms:
                self.acknowledged = self.reset_asked = False
            self.acknowledged = self.acknowledged or image.command == Command.ACKNOWLEDGE
            self.reset_asked = self.reset_asked or (self.acknowledged and image.command == Command.RESET)
        elif orders.state == State.FAULT:
            self.acknowledged = self.reset_asked = False
        if orders.state != State.FAULT:
            assert was != State.FAULT or self.reset_asked, "a fault has gone without acknowledgement and reset"
            return
        assert orders.fault, "fault without its number"
        assert orders.alarms, "fault without an alarm"
        unload = orders.reaction == Reaction.UNLOAD and orders.phase == FaultReaction.UNLOADING
        plain = orders.drive_command == DriveCommand.ENABLE_OPERATION
        assert orders.drive_command not in TOWARDS_TORQUE or (unload and plain), "a fault enables the drive"
        if orders.reaction >= Reaction.QUICK_STOP:
            assert not orders.drive_target_torque_nm, "torque after a quick stop"
            assert not orders.drive_target_velocity_rad_s, "speed after a quick stop"
