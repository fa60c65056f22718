"""The interlocks: conditions that are looked at in every scan, in the states where they mean something.

One row per interlock: the fault it raises (`controller.faults` holds reaction and wording, `controller.debounce` how
long a condition must hold), the states in which it is live, and the check. A check sees the image, what was measured
from it and the limits; it answers True when the condition is present. It keeps nothing: conditions are debounced in one
place, here.

Ages are judged less the periods that the controller itself missed: nobody asked the devices in that time. A hold-up has
an interlock of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isfinite
from typing import NamedTuple

from controller.debounce import debounce_scans, leaks
from controller.faults import FAULT_BY_ID, FAULT_BY_NUMBER
from controller.image import (
    AGE_NEVER,
    Command,
    DriveMode,
    DriveState,
    Image,
    Link,
    NmtState,
    Reaction,
    SampleStatus,
    State,
)
from controller.program import Limits, Program

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


Check = Callable[[Image, Measured, Limits, Program], bool]


def _estop(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return not i.estop_released and i.io_age_scans != AGE_NEVER


def _guard_open(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return not i.guard_closed and i.io_age_scans != AGE_NEVER


def _operator_quick_stop(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return i.command == _QUICK_STOP


def _can_lost(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return bool(i.links_lost & _CAN)


def _drive_heartbeat_lost(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return i.drive_heartbeat_age_scans - i.missed_periods > li.heartbeat_scans


def _drive_data_stale(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return i.drive_age_scans - i.missed_periods > li.drive_stale_scans or i.drive_nmt_state != _OPERATIONAL


def _amplifier_lost(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return bool(i.links_lost & _AMPLIFIER)


def _sample_stale(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return i.sample_age_scans - i.missed_periods > li.sample_stale_scans


def _sample_late(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return i.sample_age_scans - i.missed_periods > li.sample_late_scans


def _sample_frozen(_i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return m.counter_stands


def _brake_link_lost(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return bool(i.links_lost & _BRAKE) or i.brake_age_scans - i.missed_periods > li.brake_stale_scans


def _remote_io_lost(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return bool(i.links_lost & _REMOTE_IO) or i.io_age_scans - i.missed_periods > li.io_stale_scans


def _drive_fault(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return i.drive_state in _DRIVE_FAULTS


def _drive_emergency(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return i.drive_emcy_code != 0


def _drive_dropped_out(i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return m.drive_enabled_expected and i.drive_state != _ENABLED


def _drive_mode_refused(i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return m.mode_expected not in (0, i.drive_mode)


def _drive_internal_limit(i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return m.drive_enabled_expected and bool(i.drive_internal_limit)


def _drive_not_following(i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return m.drive_enabled_expected and i.drive_mode in CYCLIC_MODES and not i.drive_follows_command


def _torque_out_trip(i: Image, m: Measured, li: Limits, p: Program) -> bool:
    # where the servo loads the output, its own torque shows an overload that a stuck sensor hides
    overload = not p.loading_input and abs(i.drive_torque_nm) > li.torque_out_trip_nm * DRIVE_TORQUE_FACTOR
    return overload or abs(m.torque_out_nm) > li.torque_out_trip_nm


def _torque_in_trip(_i: Image, m: Measured, li: Limits, _p: Program) -> bool:
    return abs(m.torque_in_nm) > li.torque_in_trip_nm


def _torque_out_alarm(_i: Image, m: Measured, li: Limits, _p: Program) -> bool:
    return abs(m.torque_out_nm) > li.torque_out_alarm_nm


def _overspeed(_i: Image, m: Measured, li: Limits, _p: Program) -> bool:
    return abs(m.speed_rad_s) > li.speed_rad_s


def _over_travel(_i: Image, m: Measured, li: Limits, _p: Program) -> bool:
    return abs(m.travel_rad) > li.travel_rad


def _lock_slip(_i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return abs(m.locked_motion_rad) > m.lock_motion_limit_rad


def _brake_current_lost(i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return m.brake_current_expected_a > 0.0 and (
        not i.brake_on or i.brake_current_a < m.brake_current_expected_a - m.brake_tolerance_a
    )


def _housing_temperature(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return i.io_age_scans != AGE_NEVER and i.housing_temp_c > li.housing_temperature_c


def _missed_periods(i: Image, _m: Measured, li: Limits, _p: Program) -> bool:
    return i.missed_periods > li.missed_in_a_row


def _sensor_not_a_number(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
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


def _sensor_saturated(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return bool(i.sample_status & _SATURATED)


def _sample_not_ready(i: Image, _m: Measured, _l: Limits, _p: Program) -> bool:
    return bool(i.sample_status & _NOT_READY)


def _torque_channels_disagree(i: Image, m: Measured, li: Limits, p: Program) -> bool:
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


def _angle_channels_disagree(i: Image, m: Measured, li: Limits, p: Program) -> bool:
    apart_rad = abs(m.drive_apart_rad)
    if apart_rad <= li.angle_agreement_rad or not m.angles_compared:
        return False
    # the shaft turns on between two values of different age, and the couplings between drive and sensor twist
    scans = i.drive_age_scans + i.sample_age_scans + li.angle_lag_scans
    turned_rad = abs(m.speed_rad_s) * scans * p.period_s
    torque_nm = m.torque_in_nm if p.loading_input else m.torque_out_nm
    return apart_rad > li.angle_agreement_rad + turned_rad + abs(torque_nm) * li.coupling_rad_per_nm


def _brake_stays_closed(i: Image, m: Measured, _l: Limits, _p: Program) -> bool:
    return i.brake_age_scans != AGE_NEVER and (bool(i.brake_on) or i.brake_current_a > m.brake_tolerance_a)


CYCLIC_MODES = (DriveMode.CYCLIC_SYNC_TORQUE, DriveMode.CYCLIC_SYNC_VELOCITY)

DRIVE_TORQUE_FACTOR = 1.3
"""Torque of a load servo over that of the unit, at most: its gearbox takes its share."""

S = State
_RUNNING = frozenset({S.HOME, S.LOCK, S.CALIBRATE, S.RAMP_POS, S.REVERSE, S.RAMP_NEG, S.UNLOAD, S.RELEASE})
_LOCKED = frozenset({S.LOCK, S.CALIBRATE, S.RAMP_POS, S.REVERSE, S.RAMP_NEG, S.UNLOAD})
_LOADED = frozenset({S.CALIBRATE, S.RAMP_POS, S.REVERSE, S.RAMP_NEG})
_ALWAYS = _RUNNING | {S.FAULT}


class Interlock(NamedTuple):
    """Row of the interlock table: fault id, states in which it is live, and the check."""

    fault: str
    live_in: frozenset[State]
    check: Check


INTERLOCKS: tuple[Interlock, ...] = (
    Interlock("estop", _ALWAYS, _estop),
    Interlock("guard_open", _ALWAYS, _guard_open),
    Interlock("operator_quick_stop", _ALWAYS | {S.IDLE}, _operator_quick_stop),
    Interlock("can_lost", _ALWAYS, _can_lost),
    Interlock("drive_heartbeat_lost", _ALWAYS, _drive_heartbeat_lost),
    Interlock("drive_data_stale", _ALWAYS, _drive_data_stale),
    Interlock("amplifier_lost", _ALWAYS, _amplifier_lost),
    Interlock("sample_stale", _ALWAYS, _sample_stale),
    Interlock("sample_frozen", _RUNNING, _sample_frozen),
    Interlock("brake_link_lost", _ALWAYS, _brake_link_lost),
    Interlock("remote_io_lost", _ALWAYS, _remote_io_lost),
    Interlock("drive_fault", _ALWAYS, _drive_fault),
    Interlock("drive_emergency", _ALWAYS, _drive_emergency),
    Interlock("drive_dropped_out", _RUNNING, _drive_dropped_out),
    Interlock("drive_mode_refused", _RUNNING, _drive_mode_refused),
    Interlock("drive_internal_limit", _RUNNING, _drive_internal_limit),
    Interlock("torque_out_trip", _ALWAYS, _torque_out_trip),
    Interlock("torque_in_trip", _ALWAYS, _torque_in_trip),
    Interlock("torque_out_alarm", _LOADED, _torque_out_alarm),
    Interlock("overspeed", _ALWAYS, _overspeed),
    Interlock("over_travel", _ALWAYS, _over_travel),
    Interlock("lock_slip", _LOCKED, _lock_slip),
    Interlock("brake_current_lost", _LOCKED | {S.FAULT}, _brake_current_lost),
    Interlock("housing_temperature", _ALWAYS, _housing_temperature),
    Interlock("missed_periods", _RUNNING, _missed_periods),
    Interlock("sensor_not_a_number", _ALWAYS, _sensor_not_a_number),
    Interlock("sensor_saturated", _ALWAYS, _sensor_saturated),
    Interlock("torque_channels_disagree", _LOCKED | {S.RELEASE, S.FAULT}, _torque_channels_disagree),
    # not in FAULT, nor on the way back (`angles_compared`): a torque goes to zero there, by torque sensors that watch
    # each other, and a dead angle sensor must not stand against it
    Interlock("angle_channels_disagree", _LOCKED, _angle_channels_disagree),
    Interlock("brake_stays_closed", frozenset({S.HOME}), _brake_stays_closed),
    Interlock("sample_late", _LOADED, _sample_late),
    Interlock("sample_not_ready", _ALWAYS, _sample_not_ready),
    Interlock("drive_not_following", _LOADED | {S.UNLOAD}, _drive_not_following),
)

RAISED_BY_STEPS: frozenset[str] = frozenset(
    {
        "drive_enable_timeout",
        "homing_failed",
        "devices_not_ready",
        "tare_out_of_range",
        "tare_unsteady",
        "lock_not_closed",
        "lock_unproven",
        "target_not_reached",
        "calibration_failed",
        "unload_failed",
        "brake_stays_closed",
        "drive_mode_refused",
        "drive_dropped_out",
    },
)
"""Faults that a step of the sequence raises when what it waits for does not come."""


class Watch:
    """Runs the interlocks of a state, debounces them, and keeps what is active.

    `active` is the bit mask of conditions present now (after debouncing), `latched` of everything since the last reset.
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self._limits = program.limits
        self._rows: dict[State, tuple[tuple[Check, int, int, int], ...]] = {
            state: tuple(
                (
                    row.check,
                    FAULT_BY_ID[row.fault].number,
                    debounce_scans(FAULT_BY_ID[row.fault], program),
                    int(FAULT_BY_ID[row.fault].reaction),
                )
                for row in INTERLOCKS
                if state in row.live_in
            )
            for state in State
        }
        self._checks = {state: tuple(row[0] for row in rows) for state, rows in self._rows.items()}
        self._leaking = sum(1 << fault.number for row in INTERLOCKS if leaks(fault := FAULT_BY_ID[row.fault]))
        self._counts = [0] * 64
        self._counting = 0
        self.active = 0
        self.latched = 0

    def look(self, image: Image, measured: Measured, state: State) -> int:
        """Evaluate the live interlocks; the strongest reaction of all active ones (`Reaction` as int)."""
        limits, program = self._limits, self._program
        for check in self._checks[state]:
            if check(image, measured, limits, program):
                return self._weigh(image, measured, state)
        # the usual scan: no condition is present, so nothing counts
        if self._counting:
            self._counting = self._fall(self._counting)
        self.active = 0
        return 0

    def _weigh(self, image: Image, measured: Measured, state: State) -> int:
        """Debounce the conditions that are present."""
        limits, program, counts = self._limits, self._program, self._counts
        active = counting = strongest = 0
        for check, number, debounce, reaction in self._rows[state]:
            if check(image, measured, limits, program):
                counting |= 1 << number
                # no further than it takes: what has lasted for long is not held against a unit for as long again
                counts[number] = min(counts[number], debounce) + 1
                if counts[number] > debounce:
                    active |= 1 << number
                    strongest = max(strongest, reaction)
        self._counting = counting | self._fall(self._counting & ~counting)
        self.active = active
        self.latched |= active
        return strongest

    def _fall(self, gone: int) -> int:
        """Count conditions that are gone down by one, or to zero; return those that still count."""
        left = 0
        while gone:
            bit = gone & -gone
            gone ^= bit
            number = bit.bit_length() - 1
            count = self._counts[number] - 1 if self._leaking & bit else 0
            self._counts[number] = count
            if count:
                left |= bit
        return left

    def first_out(self, raised: int) -> int:
        """Number of the fault that counts as the cause of those raised together: the most severe, then the first."""
        best, best_reaction = 0, Reaction.NONE
        while raised:
            bit = raised & -raised
            raised ^= bit
            number = bit.bit_length() - 1
            reaction = FAULT_BY_NUMBER[number].reaction
            if reaction > best_reaction:
                best, best_reaction = number, reaction
        return best

    def forget(self) -> None:
        """After a reset by a person the latches start anew; what is counting goes on, so that nothing gains time."""
        self.active = self.latched = 0
