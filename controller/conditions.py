"""The conditions that interlocks look for: what one scan has measured, and one predicate for each.

A predicate sees the image, what was measured from it, the limits and the program; it answers True when its condition is
present. It keeps nothing and decides nothing: `controller.interlocks` says where each counts and judges.

Ages are judged less the periods that the controller itself missed: nobody asked the devices in that time. A hold-up has
a condition of its own.
"""

from __future__ import annotations

from math import inf, isfinite

from controller.image import (
    AGE_NEVER,
    Command,
    DriveMode,
    DriveState,
    Image,
    Link,
    NmtState,
    SampleStatus,
)
from controller.program import Limits, Program

CYCLIC_MODES = (DriveMode.CYCLIC_SYNC_TORQUE, DriveMode.CYCLIC_SYNC_VELOCITY)

DRIVE_TORQUE_FACTOR = 1.3
"""Torque of a load servo over that of the unit, at most: its gearbox takes its share."""

# What the checks compare with in every scan. A member looked up by its class costs as much as a whole check.
_QUICK_STOP = Command.QUICK_STOP
_CAN, _AMPLIFIER, _BRAKE, _REMOTE_IO = int(Link.CAN), int(Link.AMPLIFIER), int(Link.BRAKE), int(Link.REMOTE_IO)
_OPERATIONAL = NmtState.OPERATIONAL
_ENABLED = DriveState.OPERATION_ENABLED
_DRIVE_FAULTS = (DriveState.FAULT, DriveState.FAULT_REACTION_ACTIVE)
_SATURATED = int(SampleStatus.TORQUE_IN_SATURATED | SampleStatus.TORQUE_OUT_SATURATED)
_NOT_READY = int(SampleStatus.NOT_READY)


class Measured:
    """What one scan knows beyond the raw image: tared torques, motions since the references, what is expected.

    Torques in N·m and angles in rad. `drive_enabled_expected`, `mode_expected` and `brake_current_expected_a` are what
    the orders of earlier scans should have led to by now. `drive_apart_rad`: by how much the drive's position and the
    angle sensor of the loaded shaft have moved apart since they were set equal; `angles_compared`: whether that still
    tells anything. On the way back from a fault it does not: nobody knows where the two would agree.
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
        "lock_motion_limit_rad",
        "locked_motion_rad",
        "mode_expected",
        "speed_rad_s",
        "torque_in_nm",
        "torque_out_nm",
        "travel_rad",
    )

    def __init__(self) -> None:
        self.torque_in_nm = self.torque_out_nm = self.controlled_nm = 0.0
        self.travel_rad = self.locked_motion_rad = self.speed_rad_s = self.drive_apart_rad = 0.0
        self.lock_motion_limit_rad = inf
        self.brake_current_expected_a = self.brake_tolerance_a = 0.0
        self.drive_enabled_expected = self.counter_stands = self.agreement_live = False
        self.angles_compared = True
        self.mode_expected = 0


def estop(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return not i.estop_released and i.io_age_scans != AGE_NEVER


def guard_open(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return not i.guard_closed and i.io_age_scans != AGE_NEVER


def operator_quick_stop(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return i.command == _QUICK_STOP


def can_lost(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return bool(i.links_lost & _CAN)


def drive_heartbeat_lost(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return i.drive_heartbeat_age_scans - i.missed_periods > li.heartbeat_scans


def drive_data_stale(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return i.drive_age_scans - i.missed_periods > li.drive_stale_scans or i.drive_nmt_state != _OPERATIONAL


def amplifier_lost(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return bool(i.links_lost & _AMPLIFIER)


def sample_stale(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return i.sample_age_scans - i.missed_periods > li.sample_stale_scans


def sample_late(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return i.sample_age_scans - i.missed_periods > li.sample_late_scans


def sample_frozen(_i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return m.counter_stands


def brake_link_lost(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return bool(i.links_lost & _BRAKE) or i.brake_age_scans - i.missed_periods > li.brake_stale_scans


def remote_io_lost(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return bool(i.links_lost & _REMOTE_IO) or i.io_age_scans - i.missed_periods > li.io_stale_scans


def drive_fault(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return i.drive_state in _DRIVE_FAULTS


def drive_emergency(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return i.drive_emcy_code != 0


def drive_dropped_out(i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return m.drive_enabled_expected and i.drive_state != _ENABLED


def drive_mode_refused(i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return m.mode_expected not in (0, i.drive_mode)


def drive_internal_limit(i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return m.drive_enabled_expected and bool(i.drive_internal_limit)


def drive_not_following(i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return m.drive_enabled_expected and i.drive_mode in CYCLIC_MODES and not i.drive_follows_command


def torque_out_trip(i: Image, m: Measured, li: Limits, p: Program) -> bool:
    # where the servo loads the output, its own torque shows an overload that a stuck sensor hides
    overload = not p.loading_input and abs(i.drive_torque_nm) > li.torque_out_trip_nm * DRIVE_TORQUE_FACTOR
    return overload or abs(m.torque_out_nm) > li.torque_out_trip_nm


def torque_in_trip(_i: Image, m: Measured, li: Limits, _p: Program) -> bool:
    return abs(m.torque_in_nm) > li.torque_in_trip_nm


def torque_out_alarm(_i: Image, m: Measured, li: Limits, _p: Program) -> bool:
    return abs(m.torque_out_nm) > li.torque_out_alarm_nm


def overspeed(_i: Image, m: Measured, li: Limits, _p: Program) -> bool:
    return abs(m.speed_rad_s) > li.speed_rad_s


def over_travel(_i: Image, m: Measured, li: Limits, _p: Program) -> bool:
    return abs(m.travel_rad) > li.travel_rad


def lock_slip(_i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return abs(m.locked_motion_rad) > m.lock_motion_limit_rad


def brake_current_lost(i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return m.brake_current_expected_a > 0.0 and (
        not i.brake_on or i.brake_current_a < m.brake_current_expected_a - m.brake_tolerance_a
    )


def housing_temperature(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return i.io_age_scans != AGE_NEVER and i.housing_temp_c > li.housing_temperature_c


def missed_periods(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return i.missed_periods > li.missed_in_a_row


def sensor_not_a_number(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    # a sum is finite only when every term is: one test instead of eight
    return not isfinite(
        i.torque_in_nm
        + i.torque_out_nm
        + i.angle_in_rad
        + i.angle_out_rad
        + i.brake_current_a
        + i.housing_temp_c
        + i.drive_torque_nm
        + i.drive_angle_rad
        + i.drive_velocity_rad_s,
    )


def sensor_saturated(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return bool(i.sample_status & _SATURATED)


def sample_not_ready(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return bool(i.sample_status & _NOT_READY)


def torque_channels_disagree(i: Image, m: Measured, li: Limits, p: Program) -> bool:
    if not m.agreement_live:
        return False
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


def angle_channels_disagree(i: Image, m: Measured, li: Limits, p: Program) -> bool:
    apart_rad = abs(m.drive_apart_rad)
    if apart_rad <= li.angle_agreement_rad or not m.angles_compared:
        return False
    # the shaft turns on between two values of different age, and the couplings between drive and sensor twist
    scans = i.drive_age_scans + i.sample_age_scans + li.angle_lag_scans
    turned_rad = abs(m.speed_rad_s) * scans * p.period_s
    torque_nm = m.torque_in_nm if p.loading_input else m.torque_out_nm
    return apart_rad > li.angle_agreement_rad + turned_rad + abs(torque_nm) * li.coupling_rad_per_nm


def brake_stays_closed(i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return i.brake_age_scans != AGE_NEVER and (bool(i.brake_on) or i.brake_current_a > m.brake_tolerance_a)
