"""What happened in a run, read from its records: transitions, alarms with cause and next action, commands.

Read from sound records only (see `check.sound_table`) and not from what the scan process reports at its end, so that a
run whose scan process was killed tells its story as well; the controller's own notes are added when there are any.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import Any

import numpy as np

from definitions.faults import FAULT_BY_NUMBER, Fault
from definitions.image import Command, Reaction, State
from drivers.servo_drive.emcy import drive_said
from station.documents.events import Alarm, AlarmValues, EventRow, Note
from station.records.samples.table import Table
from station.records.samples.zeroes import from_zero

EMCY_LOOK_SCANS = 100
"""A drive sends its emergency message before or after the state that goes with it: so far it is looked for."""


def name_of(kind: type[IntEnum], number: int) -> str:
    """Return a number of the record by its name in small letters; one that this version does not know is said so."""
    try:
        return kind(number).name.lower()
    except ValueError:
        return f"unknown {kind.__name__.lower()} {number}"


def state_name(state: int) -> str:
    """Return a state as it is written in records and results."""
    return name_of(State, state)


def _transitions(table: Table, period_ns: int) -> list[EventRow]:
    # Every controller begins in idle: a stop in the very first scan is a transition too.
    states = np.concatenate(([State.IDLE], table["orders"]["state"])).astype(np.int16)
    return [
        EventRow(
            scan=scan,
            kind="transition",
            state=state_name(states[index]),
            to=state_name(states[index + 1]),
            t_s=_time_s(scan, period_ns),
        )
        for index in np.flatnonzero(np.diff(states))
        for scan in [int(table["scan"][index])]
    ]


def _time_s(scan: int, period_ns: int) -> float:
    return round(scan * period_ns * 1e-9, 6)


def _commands(table: Table, period_ns: int) -> list[EventRow]:
    commands, states = table["image"]["command"], table["orders"]["state"]
    return [
        EventRow(
            scan=scan,
            kind="command",
            state=state_name(states[index]),
            text=name_of(Command, int(commands[index])),
            t_s=_time_s(scan, period_ns),
        )
        for index in np.flatnonzero(commands)
        for scan in [int(table["scan"][index])]
    ]


def _alarms(table: Table, period_ns: int) -> list[Alarm]:
    alarms = table["orders"]["alarms"]
    if not len(alarms):
        return []
    faults = table["orders"]["fault"]
    first_out = int(faults[faults != 0][0]) if faults.any() else 0
    before = np.concatenate((np.zeros(1, dtype=alarms.dtype), alarms[:-1]))
    fresh = alarms & ~before
    found = []
    for index in np.flatnonzero(fresh):
        bits = int(fresh[index])
        numbers = [number for number in range(bits.bit_length()) if bits >> number & 1]
        found += [_alarm(table, int(index), number, period_ns, first=number == first_out) for number in numbers]
    return found


def _unknown(number: int) -> Fault:
    """Return a row for a fault that this version does not know: by its reaction in the record, not one of its own."""
    text = f"Fault {number}, which this version of the program does not know"
    cause, action = "The record was made by another version", "Look at the record with the version that made it"
    return Fault(number, f"unknown_fault_{number}", Reaction.NONE, 0, text, cause, action)


def _alarm(table: Table, index: int, number: int, period_ns: int, *, first: bool) -> Alarm:
    record = table[index]
    orders, image = record["orders"], record["image"]
    fault = FAULT_BY_NUMBER.get(number) or _unknown(number)
    reaction = fault.reaction or int(orders["reaction"])
    was = table["orders"]["state"][max(index - 1, 0)]
    scan = int(table["scan"][index])
    codes = table["image"]["drive_emcy_code"][index : index + EMCY_LOOK_SCANS]
    code = int(codes[codes != 0][0]) if codes.any() else 0
    return Alarm(
        scan=scan,
        state=state_name(was),
        id=fault.id,
        reaction=name_of(Reaction, reaction),
        text=fault.text,
        cause=fault.cause,
        next_action=fault.next_action,
        values=AlarmValues(
            torque_out_nm=_rounded(from_zero(record, "torque_out_nm"), 3),
            torque_in_nm=_rounded(from_zero(record, "torque_in_nm"), 5),
            reference_torque_nm=_rounded(orders["reference_torque_nm"], 3),
            brake_current_a=_rounded(image["brake_current_a"], 3),
        ),
        detail=drive_said(fault.id, code) or None,
        first=first,
        t_s=_time_s(scan, period_ns),
    )


def _rounded(value: Any, digits: int) -> float | None:
    """Return a figure as it is kept; None of a sensor that gave no number."""
    return round(float(value), digits) if math.isfinite(value) else None


def events_of(table: Table, period_ns: int, notes: Sequence[Note]) -> list[EventRow | Alarm]:
    """Return all events in order of time; `notes` are the controller's own, as its process reported them."""
    said = [
        EventRow(scan=one.scan, kind=one.kind, state=one.state, text=one.text, t_s=_time_s(one.scan, period_ns))
        for one in notes
    ]
    found: list[EventRow | Alarm]
    found = [*_commands(table, period_ns), *_alarms(table, period_ns), *_transitions(table, period_ns), *said]
    return sorted(found, key=lambda event: event.scan)


def has_begun(events: Sequence[EventRow | Alarm]) -> bool:
    """Say whether a run has left the state in which nothing moves, otherwise than by a stop."""
    stopped = state_name(State.STOPPED)
    return any(event.kind == "transition" and event.to != stopped for event in events if isinstance(event, EventRow))


def alarms_in(events: Sequence[EventRow | Alarm]) -> list[Alarm]:
    """Return the alarms among events in order of time; of the same scan, the one that caused the reaction first."""
    alarms = [event for event in events if isinstance(event, Alarm)]
    return sorted(alarms, key=lambda event: (event.scan, not event.first))
