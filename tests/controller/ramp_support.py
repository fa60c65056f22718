"""An undisturbed run on its way and at its end, a run in the middle of a ramp, and the faults that are shown to it."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

from programs import LIMITS, short_program
from timeline import Timeline

from controller.conditions import Measured
from definitions.faults import FAULTS
from definitions.image import (
    AGE_NEVER,
    DriveCommand,
    DriveState,
    Link,
    Reaction,
    SampleStatus,
    State,
)

S = State


# The limits that hold for a channel of the image, as it came: one more than each.
OF_THE_IMAGE: dict[str, dict[str, float]] = {
    fault.id: {fault.limit.channel: getattr(LIMITS, fault.limit.in_program) + 1}
    for fault in FAULTS
    if fault.limit and fault.limit.channel and fault.limit.channel not in Measured.__slots__
}

# fault -> what the image shows; the condition is put on in the middle of a ramp with about +200 N·m on the unit
SHOWN: dict[str, dict[str, float]] = OF_THE_IMAGE | {
    "estop": {"estop_released": 0},
    "guard_open": {"guard_closed": 0},
    "operator_quick_stop": {},
    "can_lost": {"links_lost": Link.CAN},
    "other_controller": {"links_lost": Link.CAN_SHARED},
    "amplifier_lost": {"links_lost": Link.AMPLIFIER},
    "sample_late": {"sample_age_scans": 6},
    "sample_frozen": {"sample_counter": 7},
    "brake_link_lost": {"brake_age_scans": AGE_NEVER},
    "remote_io_lost": {"links_lost": Link.REMOTE_IO},
    "drive_fault": {"drive_state": DriveState.FAULT},
    "drive_emergency": {"drive_emcy_code": 0x8130},
    "drive_dropped_out": {"drive_state": DriveState.SWITCH_ON_DISABLED},
    "drive_mode_refused": {"drive_mode": 9},
    "drive_internal_limit": {"drive_internal_limit": 1},
    "torque_out_trip": {"torque_out_nm": 495.0},
    "torque_in_trip": {"torque_in_nm": -5.5},
    "torque_out_alarm": {"torque_out_nm": 475.0},
    "overspeed": {"drive_velocity_rad_s": -6.3},
    "over_travel": {"angle_in_rad": 1.2},
    "lock_slip": {"angle_out_rad": 1e-3},
    "brake_current_lost": {"brake_current_a": 5.0},
    "sensor_not_a_number": {"torque_out_nm": math.nan},
    "sensor_saturated": {"sample_status": SampleStatus.TORQUE_OUT_SATURATED},
    "torque_channels_disagree": {"torque_in_nm": 0.0, "torque_out_nm": 400.0},
    "sample_not_ready": {"sample_status": SampleStatus.NOT_READY},
    "drive_not_following": {"drive_follows_command": 0},
    "angle_channels_disagree": {"drive_angle_rad": 40.3},
}


ORDER_OF = {
    Reaction.UNLOAD: DriveCommand.ENABLE_OPERATION,
    Reaction.QUICK_STOP: DriveCommand.QUICK_STOP,
    Reaction.POWER_OFF: DriveCommand.DISABLE_VOLTAGE,
}


class Undisturbed(NamedTuple):
    """One run of the short program: as it first comes to each state, and whole."""

    entered: dict[State, Timeline]
    whole: Timeline


@cache
def _undisturbed(speed_rad_s: float) -> Undisturbed:
    run, entered = Timeline(short_program(speed_rad_s=speed_rad_s)), {}
    while not run.controller.finished:
        state = State(run.go().state)
        if state not in entered:
            entered[state] = run.branch()
    return Undisturbed(entered, run)


def entered(state: State) -> Timeline:
    """Return a run that has just come to a state for the first time; it goes on by itself."""
    return _undisturbed(0.0).entered[state].branch()


def whole_run(speed_rad_s: float = 0.0) -> Timeline:
    """Return a run that has come to its end; all look at the same one, and who goes on from there takes a branch."""
    return _undisturbed(speed_rad_s).whole


@cache
def _run_in_ramp() -> Timeline:
    run = entered(S.RAMP_NEG)
    run.until(lambda orders: orders.controlled_torque_nm < 200.0)
    return run


def mid_ramp() -> Timeline:
    return _run_in_ramp().branch()
