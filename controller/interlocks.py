"""The interlocks: conditions that are looked at in every scan, in the states where they mean something.

One row per interlock: the fault it raises (`controller.faults` holds reaction and wording, `controller.debounce` how
long a condition must hold), the states in which it is live, and the condition (`controller.conditions`). Conditions are
debounced in one place, here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from controller import conditions
from controller.conditions import Measured
from controller.debounce import debounce_scans, leaks
from controller.faults import FAULT_BY_ID
from controller.image import Image, State
from controller.program import Limits, Program

Check = Callable[[Image, Measured, Limits, Program], bool]

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
    Interlock("estop", _ALWAYS, conditions.estop),
    Interlock("guard_open", _ALWAYS, conditions.guard_open),
    Interlock("operator_quick_stop", _ALWAYS | {S.IDLE}, conditions.operator_quick_stop),
    Interlock("can_lost", _ALWAYS, conditions.can_lost),
    Interlock("drive_heartbeat_lost", _ALWAYS, conditions.drive_heartbeat_lost),
    Interlock("drive_data_stale", _ALWAYS, conditions.drive_data_stale),
    Interlock("amplifier_lost", _ALWAYS, conditions.amplifier_lost),
    Interlock("sample_stale", _ALWAYS, conditions.sample_stale),
    Interlock("sample_frozen", _RUNNING, conditions.sample_frozen),
    Interlock("brake_link_lost", _ALWAYS, conditions.brake_link_lost),
    Interlock("remote_io_lost", _ALWAYS, conditions.remote_io_lost),
    Interlock("drive_fault", _ALWAYS, conditions.drive_fault),
    Interlock("drive_emergency", _ALWAYS, conditions.drive_emergency),
    Interlock("drive_dropped_out", _RUNNING, conditions.drive_dropped_out),
    Interlock("drive_mode_refused", _RUNNING, conditions.drive_mode_refused),
    Interlock("drive_internal_limit", _RUNNING, conditions.drive_internal_limit),
    Interlock("torque_out_trip", _ALWAYS, conditions.torque_out_trip),
    Interlock("torque_in_trip", _ALWAYS, conditions.torque_in_trip),
    Interlock("torque_out_alarm", _LOADED, conditions.torque_out_alarm),
    Interlock("overspeed", _ALWAYS, conditions.overspeed),
    Interlock("over_travel", _ALWAYS, conditions.over_travel),
    Interlock("lock_slip", _LOCKED, conditions.lock_slip),
    Interlock("brake_current_lost", _LOCKED | {S.FAULT}, conditions.brake_current_lost),
    Interlock("housing_temperature", _ALWAYS, conditions.housing_temperature),
    Interlock("missed_periods", _RUNNING, conditions.missed_periods),
    Interlock("sensor_not_a_number", _ALWAYS, conditions.sensor_not_a_number),
    Interlock("sensor_saturated", _ALWAYS, conditions.sensor_saturated),
    Interlock("torque_channels_disagree", _LOCKED | {S.RELEASE, S.FAULT}, conditions.torque_channels_disagree),
    # not in FAULT, nor on the way back (`angles_compared`): a torque goes to zero there, by torque sensors that watch
    # each other, and a dead angle sensor must not stand against it
    Interlock("angle_channels_disagree", _LOCKED, conditions.angle_channels_disagree),
    Interlock("brake_stays_closed", frozenset({S.HOME}), conditions.brake_stays_closed),
    Interlock("sample_late", _LOADED, conditions.sample_late),
    Interlock("sample_not_ready", _ALWAYS, conditions.sample_not_ready),
    Interlock("drive_not_following", _LOADED | {S.UNLOAD}, conditions.drive_not_following),
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

    def forget(self) -> None:
        """After a reset by a person the latches start anew; what is counting goes on, so that nothing gains time."""
        self.active = self.latched = 0
