"""The conditions that interlocks look for: what one scan has measured, and which conditions are present in it.

A test answers with a mask, bit n for fault number n. It sees the image, what was measured from it, the limits and the
program; it keeps nothing and decides nothing: `controller.interlocks` says where each condition counts, and judges.
There is one for each kind of conditions (`KINDS`): a call for each condition would be most of a scan's time. What is a
channel against a limit, and no more, has no test here: `controller.beyond_limits` reads it off the fault table.

Ages are judged less the periods that the controller itself missed: nobody asked the devices in that time. A hold-up has
a condition of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isfinite
from typing import NamedTuple

from definitions.faults import bit_of
from definitions.image import (
    AGE_NEVER,
    Command,
    DriveMode,
    DriveState,
    Image,
    Link,
    NmtState,
    SampleStatus,
)
from definitions.program import Limits, Program

CYCLIC_MODES = (DriveMode.CYCLIC_SYNC_TORQUE, DriveMode.CYCLIC_SYNC_VELOCITY)

DRIVE_TORQUE_FACTOR = 1.3
"""Torque of a load servo over that of the unit, at most: its gearbox takes its share."""

# What the checks compare with in every scan. A member looked up by its class costs as much as a whole check.
_QUICK_STOP = Command.QUICK_STOP
_CAN, _AMPLIFIER, _BRAKE, _REMOTE_IO = int(Link.CAN), int(Link.AMPLIFIER), int(Link.BRAKE), int(Link.REMOTE_IO)
_CAN_SHARED = int(Link.CAN_SHARED)
_OPERATIONAL = NmtState.OPERATIONAL
_ENABLED = DriveState.OPERATION_ENABLED
_DRIVE_FAULTS = (DriveState.FAULT, DriveState.FAULT_REACTION_ACTIVE)
_SATURATED = int(SampleStatus.TORQUE_IN_SATURATED | SampleStatus.TORQUE_OUT_SATURATED)
_NOT_READY = int(SampleStatus.NOT_READY)

# The bits of the conditions, by kind.
ESTOP, GUARD_OPEN = bit_of("estop"), bit_of("guard_open")
OPERATOR_QUICK_STOP = bit_of("operator_quick_stop")

CAN_LOST, AMPLIFIER_LOST = bit_of("can_lost"), bit_of("amplifier_lost")
OTHER_CONTROLLER = bit_of("other_controller")
BRAKE_LINK_LOST, REMOTE_IO_LOST = bit_of("brake_link_lost"), bit_of("remote_io_lost")
DRIVE_DATA_STALE = bit_of("drive_data_stale")
SAMPLE_LATE, SAMPLE_FROZEN = bit_of("sample_late"), bit_of("sample_frozen")

DRIVE_FAULT, DRIVE_EMERGENCY = bit_of("drive_fault"), bit_of("drive_emergency")
DRIVE_DROPPED_OUT, DRIVE_MODE_REFUSED = bit_of("drive_dropped_out"), bit_of("drive_mode_refused")
DRIVE_INTERNAL_LIMIT, DRIVE_NOT_FOLLOWING = bit_of("drive_internal_limit"), bit_of("drive_not_following")

TORQUE_OUT_TRIP = bit_of("torque_out_trip")
LOCK_SLIP, BRAKE_CURRENT_LOST = bit_of("lock_slip"), bit_of("brake_current_lost")
BRAKE_STAYS_CLOSED = bit_of("brake_stays_closed")

SENSOR_NOT_A_NUMBER, SENSOR_SATURATED = bit_of("sensor_not_a_number"), bit_of("sensor_saturated")
SAMPLE_NOT_READY = bit_of("sample_not_ready")
TORQUE_CHANNELS_DISAGREE = bit_of("torque_channels_disagree")
ANGLE_CHANNELS_DISAGREE = bit_of("angle_channels_disagree")


class Measured:
    """What one scan knows beyond the raw image: tared torques, motions since the references, what is expected.

    Torques in N·m and angles in rad. `drive_enabled_expected`, `mode_expected` and `brake_current_expected_a` are what
    the orders of earlier scans should have led to by now. `fastest_rad_s`: the largest speed for as long as a value may
    be old (`Context.keep_fastest`). `request_age_scans`: scans since the sample was asked for, at most.
    `drive_apart_rad`: by how much the drive's position and the angle sensor of the loaded shaft have moved apart since
    they were set equal; `angles_compared`: whether that still tells anything. During the recovery from a fault it does
    not: nobody knows where the two would agree.
    """

    __slots__ = (
        "agreement_live",
        "angles_compared",
        "brake_current_expected_a",
        "brake_tolerance_a",
        "controlled_nm",
        "counter_stands",
        "drive_apart_rad",
        "drive_enabled_expected",
        "fastest_rad_s",
        "lock_motion_limit_rad",
        "locked_motion_rad",
        "mode_expected",
        "request_age_scans",
        "speed_rad_s",
        "torque_in_nm",
        "torque_out_nm",
        "travel_rad",
    )

    def __init__(self) -> None:
        self.torque_in_nm = self.torque_out_nm = self.controlled_nm = 0.0
        self.travel_rad = self.locked_motion_rad = self.speed_rad_s = self.drive_apart_rad = 0.0
        self.fastest_rad_s = 0.0
        self.lock_motion_limit_rad = inf
        self.brake_current_expected_a = self.brake_tolerance_a = 0.0
        self.drive_enabled_expected = self.counter_stands = self.agreement_live = False
        self.angles_compared = True
        self.mode_expected = self.request_age_scans = 0


def _surroundings(i: Image, *_: object) -> int:
    """People: what they open and press."""
    bits = 0
    if i.io_age_scans != AGE_NEVER:
        if not i.estop_released:
            bits |= ESTOP
        if not i.guard_closed:
            bits |= GUARD_OPEN
    if i.command == _QUICK_STOP:
        bits |= OPERATOR_QUICK_STOP
    return bits


def _connections(i: Image, m: Measured, li: Limits, *_: object) -> int:
    """Links that are down, and values that grow too old."""
    bits, lost = 0, i.links_lost
    if lost & _CAN:
        bits |= CAN_LOST
    if lost & _CAN_SHARED:
        bits |= OTHER_CONTROLLER
    if i.drive_nmt_state != _OPERATIONAL:
        bits |= DRIVE_DATA_STALE
    if lost & _AMPLIFIER:
        bits |= AMPLIFIER_LOST
    if i.sample_age_scans - i.missed_periods > li.sample_late_scans:
        bits |= SAMPLE_LATE
    if m.counter_stands:
        bits |= SAMPLE_FROZEN
    if lost & _BRAKE:
        bits |= BRAKE_LINK_LOST
    if lost & _REMOTE_IO:
        bits |= REMOTE_IO_LOST
    return bits


def _drive(i: Image, m: Measured, *_: object) -> int:
    """What the drive says of itself, and what it does otherwise than it was ordered."""
    bits = 0
    if i.drive_state in _DRIVE_FAULTS:
        bits |= DRIVE_FAULT
    if i.drive_emcy_code:
        bits |= DRIVE_EMERGENCY
    if m.mode_expected and m.mode_expected != i.drive_mode:
        bits |= DRIVE_MODE_REFUSED
    if m.drive_enabled_expected:
        if i.drive_state != _ENABLED:
            bits |= DRIVE_DROPPED_OUT
        if i.drive_internal_limit:
            bits |= DRIVE_INTERNAL_LIMIT
        if not i.drive_follows_command and i.drive_mode in CYCLIC_MODES:
            bits |= DRIVE_NOT_FOLLOWING
    return bits


def _load(i: Image, m: Measured, li: Limits, p: Program) -> int:
    """An overload that the torque sensor may hide, the lock, and what holds it."""
    bits = 0
    # where the servo loads the output, its own torque shows an overload that a stuck sensor hides
    if not p.loading_input and abs(i.drive_torque_nm) > li.torque_out_trip_nm * DRIVE_TORQUE_FACTOR:
        bits |= TORQUE_OUT_TRIP
    if abs(m.locked_motion_rad) > m.lock_motion_limit_rad:
        bits |= LOCK_SLIP
    if m.brake_current_expected_a > 0.0 and (
        not i.brake_on or i.brake_current_a < m.brake_current_expected_a - m.brake_tolerance_a
    ):
        bits |= BRAKE_CURRENT_LOST
    if i.brake_age_scans != AGE_NEVER and (i.brake_on or i.brake_current_a > m.brake_tolerance_a):
        bits |= BRAKE_STAYS_CLOSED
    return bits


def _sensors(i: Image, m: Measured, li: Limits, p: Program) -> int:
    """Values that cannot be, or contradict each other."""
    bits = 0
    # a sum is finite only when every term is: one test instead of eight
    if not isfinite(
        i.torque_in_nm
        + i.torque_out_nm
        + i.angle_in_rad
        + i.angle_out_rad
        + i.brake_current_a
        + i.housing_temp_c
        + i.drive_torque_nm
        + i.drive_angle_rad
        + i.drive_velocity_rad_s
    ):
        bits |= SENSOR_NOT_A_NUMBER
    if i.sample_status:
        if i.sample_status & _SATURATED:
            bits |= SENSOR_SATURATED
        if i.sample_status & _NOT_READY:
            bits |= SAMPLE_NOT_READY
    if m.agreement_live and _torques_disagree(i, m, li, p):
        bits |= TORQUE_CHANNELS_DISAGREE
    if m.angles_compared and abs(m.drive_apart_rad) > li.angle_agreement_rad and _angles_disagree(i, m, li, p):
        bits |= ANGLE_CHANNELS_DISAGREE
    return bits


def _torques_disagree(i: Image, m: Measured, li: Limits, p: Program) -> bool:
    out_nm, margin_nm = m.torque_out_nm, li.torque_agreement_nm
    if p.loading_input:
        ideal_nm, factor = m.torque_in_nm * p.ratio, li.torque_agreement_ratio
    else:
        ideal_nm, factor = i.drive_torque_nm, DRIVE_TORQUE_FACTOR
    if ideal_nm * out_nm < 0.0:
        # friction lets them differ in sign near zero only
        return abs(out_nm) + abs(ideal_nm) / factor > margin_nm
    ideal_nm, out_nm = abs(ideal_nm), abs(out_nm)
    return out_nm > ideal_nm * factor + margin_nm or out_nm < ideal_nm / factor - margin_nm


def _angles_disagree(i: Image, m: Measured, li: Limits, p: Program) -> bool:
    """Whether they are further apart than at rest, and than what explains it."""
    # The shaft turns on between two values of different age, and the couplings between drive and sensor twist. It may
    # have been faster then than it is now.
    scans = i.drive_age_scans + m.request_age_scans + li.angle_lag_scans
    turned_rad = m.fastest_rad_s * scans * p.period_s
    torque_nm = m.torque_in_nm if p.loading_input else m.torque_out_nm
    return abs(m.drive_apart_rad) > li.angle_agreement_rad + turned_rad + abs(torque_nm) * li.coupling_rad_per_nm


Test = Callable[[Image, Measured, Limits, Program], int]
"""Returns the bits of the conditions that are present, whether an interlock is live for them or not."""


class Kind(NamedTuple):
    """Conditions that are looked for together: by which test, and the bits that it may answer with."""

    test: Test
    bits: int


KINDS = (
    Kind(_surroundings, ESTOP | GUARD_OPEN | OPERATOR_QUICK_STOP),
    Kind(
        _connections,
        CAN_LOST
        | OTHER_CONTROLLER
        | AMPLIFIER_LOST
        | BRAKE_LINK_LOST
        | REMOTE_IO_LOST
        | DRIVE_DATA_STALE
        | SAMPLE_LATE
        | SAMPLE_FROZEN,
    ),
    Kind(
        _drive,
        DRIVE_FAULT
        | DRIVE_EMERGENCY
        | DRIVE_DROPPED_OUT
        | DRIVE_MODE_REFUSED
        | DRIVE_INTERNAL_LIMIT
        | DRIVE_NOT_FOLLOWING,
    ),
    Kind(_load, TORQUE_OUT_TRIP | LOCK_SLIP | BRAKE_CURRENT_LOST | BRAKE_STAYS_CLOSED),
    Kind(
        _sensors,
        SENSOR_NOT_A_NUMBER | SENSOR_SATURATED | SAMPLE_NOT_READY | TORQUE_CHANNELS_DISAGREE | ANGLE_CHANNELS_DISAGREE,
    ),
)
"""Each kind with all of its bits: where none of them is live, its test is not asked."""
