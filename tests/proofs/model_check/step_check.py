"""One step held against the rules; a `Monitor` remembers what a rule needs from the past.

The checks are made for every step of every walk: the text of a breach is written only when there is one.
"""

from __future__ import annotations

from typing import NamedTuple

from safety_rules import ALLOWED, LOADED, LOCKED, broken, require
from small_bench import (
    JOG,
    LOCK_A,
    LOCK_TOLERANCE_A,
    PROOF_NM,
    RELEASE_NM,
    SLEW_NM,
    TORQUE_LIMIT_NM,
    ZERO_NM,
    BenchState,
)

from controller.aftermath import FaultReaction
from controller.interlocks import INTERLOCKS
from definitions.faults import FAULT_BY_ID
from definitions.image import Command, DriveCommand, DriveMode, DriveState, Image, Orders, Reaction, State

S, R = State, Reaction
RESTING = (S.IDLE, S.COMPLETE, S.STOPPED)
ENABLING = (DriveCommand.ENABLE_OPERATION, DriveCommand.START_HOMING)
TOWARDS_TORQUE = (DriveCommand.SWITCH_ON, *ENABLING)
OFF = (
    DriveState.SWITCH_ON_DISABLED,
    DriveState.NOT_READY_TO_SWITCH_ON,
    DriveState.READY_TO_SWITCH_ON,
    DriveState.FAULT,
)
WATCHED_ALARMS = sum(1 << FAULT_BY_ID[row.fault].number for row in INTERLOCKS if S.FAULT in row.live_in)
"""What can come up in a fault as another cause. Any other alarm stays in a fault what it was when the fault began."""

PROVE_SCANS = 2
HOLD_SCANS = 2
EPSILON = 1e-9


class Monitor(NamedTuple):
    """What the rules need to know of the past."""

    started: bool = False
    acknowledged: bool = False
    alarms: int = 0  # of `WATCHED_ALARMS`, seen in this fault
    reset_asked: bool = False
    tared: bool = False
    proof_up: bool = False
    proof_down: bool = False
    low_scans: int = 0
    left: bool = False  # a bench that an earlier run has left wound up: what holds that is proven for the way to zero
    held_scans: int = 0
    lock_proven: bool = False
    way_back: bool = False  # since the reset of a fault
    token_age: int = 9  # of a jog's token, in scans, and the direction that it asks for
    token_way: int = 0
    contact_open: bool = False  # of the enabling device: seen so while the key was held, with the drive off


def _cause_present(image: Image) -> bool:
    return not image.estop_released or not image.guard_closed or bool(image.links_lost)


def check_step(before: BenchState, monitor: Monitor, image: Image, orders: Orders) -> Monitor:
    """Hold one step against the rules and return what is to be remembered; `before.orders` are the last scan's."""
    was = before.orders
    now, last = orders.state, was.state
    if now != last and now not in ALLOWED[last]:
        broken(1, f"{last.name} -> {now.name}")
    _check_fault(image, orders)
    _check_set_points(was, image, orders)
    low_scans = 0
    if last == S.RELEASE and abs(image.torque_out_nm - ZERO_NM) <= RELEASE_NM and image.sample_age_scans <= 5:
        low_scans = min(monitor.low_scans + 1, PROVE_SCANS)
    if was.brake_on and not orders.brake_on and (last != S.IDLE or image.brake_on):
        off = image.drive_state in OFF
        if last != S.RELEASE or not off or low_scans < PROVE_SCANS:
            broken(4, f"in {last.name}, drive {image.drive_state}, low for {low_scans} scans")
    if now in RESTING:
        # a lock that is found closed before anything was started stays as it was found
        found_closed = now != S.COMPLETE and was.brake_on and image.brake_on
        if orders.drive_command != DriveCommand.DISABLE_VOLTAGE or (orders.brake_on and not found_closed):
            broken(8, f"{now.name} with drive command {orders.drive_command}, brake order {orders.brake_on}")
    # by a stop during the proof the drive comes to UNLOAD enabled; nothing switches it on there before
    off = image.drive_state != DriveState.OPERATION_ENABLED and not monitor.lock_proven
    if now == S.UNLOAD and off and orders.drive_command != DriveCommand.DISABLE_VOLTAGE:
        broken(7, f"drive command {orders.drive_command} in UNLOAD before the lock is proven")
    monitor = _remember_lock(_remember(monitor, last, now, image, orders), last, now, image, orders)
    _check_lock(monitor, now, orders, closed=image.brake_on or was.brake_on)
    if S.JOG in (now, last):
        monitor = _check_jog(monitor, was, image, orders)
    low_scans = low_scans if now == S.RELEASE else 0
    return monitor if monitor.low_scans == low_scans else monitor._replace(low_scans=low_scans)


def _check_fault(image: Image, orders: Orders) -> None:
    if orders.state != S.FAULT:
        if orders.fault:
            broken(1, "a fault number without a fault")
        return
    enabling = orders.drive_command in TOWARDS_TORQUE
    if enabling:
        unload = orders.reaction == R.UNLOAD and orders.phase == FaultReaction.UNLOADING
        plain = orders.drive_command == DriveCommand.ENABLE_OPERATION
        if not (unload and plain and image.drive_state == DriveState.OPERATION_ENABLED):
            broken(2, f"drive command {orders.drive_command} in phase {orders.phase}, drive state {image.drive_state}")
    if orders.reaction >= R.QUICK_STOP and (
        orders.drive_target_torque_nm or orders.drive_target_velocity_rad_s or enabling
    ):
        broken(3, f"reaction {orders.reaction}: {orders}")
    if not orders.fault:
        broken(1, "a fault without its number")


def _check_set_points(was: Orders, image: Image, orders: Orders) -> None:
    torque_nm, speed = orders.drive_target_torque_nm, orders.drive_target_velocity_rad_s
    if not (abs(torque_nm) <= TORQUE_LIMIT_NM and abs(speed) <= 1.0):
        broken(5, f"torque {torque_nm} N·m, speed {speed} rad/s")
    acts = orders.drive_command in ENABLING and was.drive_command in ENABLING
    if not acts or image.drive_state != DriveState.OPERATION_ENABLED:
        return
    if orders.drive_mode == was.drive_mode == DriveMode.CYCLIC_SYNC_TORQUE:
        step_nm = abs(torque_nm - was.drive_target_torque_nm)
        if not step_nm <= SLEW_NM + EPSILON:
            broken(6, f"torque steps by {step_nm} N·m")
    if orders.drive_mode == was.drive_mode == DriveMode.CYCLIC_SYNC_VELOCITY:
        step = abs(speed - was.drive_target_velocity_rad_s)
        # a dwell stops the shaft at once: from what was left at the turning point
        if not step <= 1.0 + EPSILON:
            broken(6, f"speed steps by {step} rad/s")


def _check_lock(monitor: Monitor, now: State, orders: Orders, *, closed: int) -> None:
    if now in LOADED and not (monitor.proof_up and monitor.proof_down):
        broken(7, f"{now.name} without the proof of the lock")
    if now in LOCKED and monitor.tared and orders.torque_out_tare_nm != ZERO_NM:
        broken(7, f"{now.name} with a zero of {orders.torque_out_tare_nm} N·m")
    moving = orders.drive_target_torque_nm or orders.drive_target_velocity_rad_s
    if not moving:
        return
    if orders.drive_command in ENABLING and not orders.brake_on and now != S.JOG:
        broken(7, f"{orders.drive_target_torque_nm} N·m in {now.name}, brake order {orders.brake_on}")
    if now == S.LOCK:
        if not closed:
            broken(7, "the lock has not been seen closed")
        if not abs(orders.drive_target_torque_nm) <= TORQUE_LIMIT_NM:
            broken(7, f"{orders.drive_target_torque_nm} N·m before the proof")


LONG_AGO = JOG.token_scans + 2
WAYS = {Command.JOG_POSITIVE: 1, Command.JOG_NEGATIVE: -1}


def _check_jog(monitor: Monitor, was: Orders, image: Image, orders: Orders) -> Monitor:
    """Hold one scan of a jog against its rule, and return what is to be remembered of key and enabling device."""
    if was.state != S.JOG:
        require(8, "a jog without a start", holds=monitor.started)
        return monitor._replace(token_age=LONG_AGO, token_way=0, contact_open=False)
    age = min(monitor.token_age + 1 + image.missed_periods, LONG_AGO)
    way = WAYS.get(image.command, 0)
    held = age <= JOG.token_scans and way in (0, monitor.token_way) and monitor.started
    age, way = (0, way) if way else (age, monitor.token_way)
    both = held and bool(image.enabling_device)
    before, speed = was.drive_target_velocity_rad_s, orders.drive_target_velocity_rad_s
    slower = abs(speed) <= max(abs(before) - JOG.deceleration_rad_s2, 0.0) + EPSILON and speed * before >= 0.0
    if not slower and not (both and speed * way > 0.0):
        broken(13, f"speed {before} -> {speed} rad/s, key held: {held}, enabling device: {image.enabling_device}")
    if orders.drive_command in ENABLING and abs(speed - before) > JOG.acceleration_rad_s2 + EPSILON:
        broken(6, f"speed of a jog steps by {speed - before} rad/s")
    began = orders.drive_command in (*TOWARDS_TORQUE, DriveCommand.SHUTDOWN)
    if began and was.drive_command == DriveCommand.DISABLE_VOLTAGE and was.phase != orders.phase:
        require(13, "drive switched on without a new press", holds=both and monitor.contact_open)
    if began and (image.brake_on or image.brake_current_a > LOCK_TOLERANCE_A):
        broken(13, "drive on with the lock closed")
    if orders.drive_target_torque_nm or (orders.brake_on and not (was.brake_on or image.brake_on)):
        broken(13, f"torque {orders.drive_target_torque_nm} N·m, brake order {orders.brake_on}")
    drive_off = was.drive_command == DriveCommand.DISABLE_VOLTAGE
    contact_open = held and drive_off and (monitor.contact_open or not image.enabling_device)
    if began:
        contact_open = False
    return monitor._replace(token_age=age, token_way=way, contact_open=contact_open)


def _remember(monitor: Monitor, last: State, now: State, image: Image, orders: Orders) -> Monitor:
    if image.command == Command.START and last == S.IDLE:
        monitor = monitor._replace(started=True)
    elif image.command == Command.STOP:
        monitor = monitor._replace(started=False)
    if now == S.HOME and last == S.IDLE:
        require(8, "home without a start", holds=monitor.started)
        monitor = Monitor(left=monitor.left)
    if now == S.LOCK and last == S.HOME:
        monitor = monitor._replace(tared=True)
    if last == S.LOCK and image.brake_on:
        monitor = monitor._replace(
            proof_up=monitor.proof_up or image.torque_out_nm >= 0.75 * PROOF_NM,
            proof_down=monitor.proof_down or image.torque_out_nm <= -0.75 * PROOF_NM,
        )
    if now not in LOADED and now != S.LOCK and (monitor.proof_up or monitor.proof_down):
        # the next load wants its own proof
        monitor = monitor._replace(proof_up=False, proof_down=False)
    if now not in LOCKED and monitor.tared:
        monitor = monitor._replace(tared=False)
    return _remember_fault(monitor, last, now, image, orders)


def _remember_lock(monitor: Monitor, last: State, now: State, image: Image, orders: Orders) -> Monitor:
    """A lock is proven by its proof, and by what it holds where a run has left it loaded, until it is opened."""
    held_scans, proven = 0, monitor.lock_proven
    if monitor.left and not proven and last == now == S.UNLOAD:
        closed = image.brake_on and image.brake_current_a >= LOCK_A - LOCK_TOLERANCE_A
        held_scans = monitor.held_scans + 1 if closed and image.sample_age_scans <= 5 else 0
    if held_scans >= HOLD_SCANS or (now in LOADED and monitor.proof_up and monitor.proof_down):
        held_scans, proven = 0, True
    if not orders.brake_on:
        proven = False
    if (held_scans, proven) == (monitor.held_scans, monitor.lock_proven):
        return monitor
    return monitor._replace(held_scans=held_scans, lock_proven=proven)


def _remember_fault(monitor: Monitor, last: State, now: State, image: Image, orders: Orders) -> Monitor:
    alarms = orders.alarms & WATCHED_ALARMS
    if last != S.FAULT:
        fault = Monitor(alarms=alarms, left=monitor.left, lock_proven=monitor.lock_proven)
        return fault if now == S.FAULT else monitor
    if now == S.FAULT and alarms & ~monitor.alarms:
        # another fault on top wants its own acknowledgement
        monitor = monitor._replace(acknowledged=False, reset_asked=False, alarms=alarms)
    if image.command == Command.ACKNOWLEDGE:
        monitor = monitor._replace(acknowledged=True)
    if image.command == Command.RESET and monitor.acknowledged:
        monitor = monitor._replace(reset_asked=True)
    if now == S.FAULT:
        if monitor.reset_asked and orders.phase != FaultReaction.DRIVE_RESET:
            # refused, or over: the next recovery needs its own
            monitor = monitor._replace(reset_asked=False)
        return monitor
    require(9, "no acknowledgement", holds=monitor.acknowledged)
    require(9, "no reset asked for", holds=monitor.reset_asked)
    require(9, "the cause is still present", holds=not _cause_present(image))
    return Monitor(left=monitor.left, lock_proven=monitor.lock_proven, way_back=True)
