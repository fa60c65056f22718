"""The interlocks: conditions that are looked at in every scan, in the states where they mean something.

Each is a row of `definitions.faults` with its states. Whether its condition is present says `controller.beyond_limits`
where a channel is held against a limit of the row, and `controller.conditions` for the others, by the fault's bit.
Conditions are debounced in one place, here.
"""

from __future__ import annotations

from typing import NamedTuple

from controller.beyond_limits import BeyondLimits
from controller.conditions import KINDS, Kind, Measured
from controller.debounce import debounce_scans, leaks
from definitions.faults import FAULT_BY_ID, FAULTS, bit_of
from definitions.image import Image, State
from definitions.program import Program


class Interlock(NamedTuple):
    """Row of the interlock table: fault id, and the states in which it is live."""

    fault: str
    live_in: frozenset[State]


INTERLOCKS: tuple[Interlock, ...] = tuple(Interlock(fault.id, fault.live_in) for fault in FAULTS if fault.live_in)

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
        "enabling_device_stuck",
        "jog_not_stopped",
    },
)
"""Faults that a step of the sequence raises when what it waits for does not come."""


class Debounced(NamedTuple):
    """What `Watch` knows of an interlock: for how many scans its condition may hold, and its `Reaction` as int."""

    scans: int
    reaction: int


class Watch:
    """Runs the interlocks of a state, debounces them, and keeps what is active.

    `active` is the bit mask of conditions present now (after debouncing), `latched` of everything since the last reset.
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self._limits = program.limits
        beyond_limits = BeyondLimits(program.limits)
        kinds = (*KINDS, Kind(beyond_limits.present, beyond_limits.bits))
        faults = [FAULT_BY_ID[row.fault] for row in INTERLOCKS]
        self._live = {state: sum(bit_of(row.fault) for row in INTERLOCKS if state in row.live_in) for state in State}
        self._tests = {state: [kind.test for kind in kinds if kind.bits & live] for state, live in self._live.items()}
        self._rows = {f.number: Debounced(debounce_scans(f, program), int(f.reaction)) for f in faults}
        self._leaking = sum(1 << fault.number for fault in faults if leaks(fault))
        self._counts = [0] * 64
        self._counting = 0
        self.active = 0
        self.latched = 0

    def look(self, image: Image, measured: Measured, state: State) -> int:
        """Evaluate the live interlocks; the strongest reaction of all active ones (`Reaction` as int)."""
        limits, program, found = self._limits, self._program, 0
        for test in self._tests[state]:
            found |= test(image, measured, limits, program)
        found &= self._live[state]
        if found:
            return self._weigh(found)
        # the usual scan: no condition is present, so nothing counts
        if self._counting:
            self._counting = self._fall(self._counting)
        self.active = 0
        return 0

    def _weigh(self, found: int) -> int:
        """Debounce the conditions that are present."""
        counts = self._counts
        active = strongest = 0
        rest = found
        while rest:
            bit = rest & -rest
            rest ^= bit
            number = bit.bit_length() - 1
            debounce, reaction = self._rows[number]
            # no further than it takes: what has lasted for long is not held against a unit for as long again
            counts[number] = min(counts[number], debounce) + 1
            if counts[number] > debounce:
                active |= bit
                strongest = max(strongest, reaction)
        self._counting = found | self._fall(self._counting & ~found)
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
