"""What happened in a run, read from its records: transitions, alarms with cause and next action, commands.

Read from sound records only (see `check.sound_table`) and not from what the scan process reports at its end, so that a
run whose scan process was killed tells its story as well; the controller's own notes are added when there are any.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from definitions.faults import FAULT_BY_NUMBER, Fault
from definitions.image import Command, Reaction, State
from drivers.servo_drive.emcy import explain_emcy
from station.records.samples.table import Table
from station.records.samples.zeroes import from_zero

DRIVE_ALARMS = frozenset({"drive_fault", "drive_emergency", "drive_dropped_out"})


def name_of(kind: type[IntEnum], number: int) -> str:
    """Return a number of the record by its name in small letters; one that this version does not know is said so."""
    try:
        return kind(number).name.lower()
    except ValueError:
        return f"unknown {kind.__name__.lower()} {number}"


def state_name(state: int) -> str:
    """Return a state as it is written in records and results."""
    return name_of(State, state)


def _row(table: Table, index: Any, kind: str) -> dict[str, Any]:
    return {"scan": int(table["scan"][index]), "kind": kind}


def _transitions(table: Table) -> list[dict[str, Any]]:
    # Every controller begins in idle: a stop in the very first scan is a transition too.
    states = np.concatenate(([State.IDLE], table["orders"]["state"])).astype(np.int16)
    found = []
    for index in np.flatnonzero(np.diff(states)):
        event = _row(table, index, "transition")
        found.append(event | {"state": state_name(states[index]), "to": state_name(states[index + 1])})
    return found


def _commands(table: Table) -> list[dict[str, Any]]:
    commands, states = table["image"]["command"], table["orders"]["state"]
    return [
        _row(table, index, "command")
        | {"state": state_name(states[index]), "text": name_of(Command, int(commands[index]))}
        for index in np.flatnonzero(commands)
    ]


def _alarms(table: Table) -> list[dict[str, Any]]:
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
        found += [_alarm(table, int(index), number) | {"first": number == first_out} for number in numbers]
    return found


def _unknown(number: int) -> Fault:
    """Return a row for a fault that this version does not know: by its reaction in the record, not one of its own."""
    text = f"Fault {number}, which this version of the program does not know"
    cause, action = "The record was made by another version", "Look at the record with the version that made it"
    return Fault(number, f"unknown_fault_{number}", Reaction.NONE, 0, text, cause, action)


def _alarm(table: Table, index: int, number: int) -> dict[str, Any]:
    record = table[index]
    orders, image = record["orders"], record["image"]
    fault = FAULT_BY_NUMBER.get(number) or _unknown(number)
    reaction = fault.reaction or int(orders["reaction"])
    was = table["orders"]["state"][max(index - 1, 0)]
    event = _row(table, index, "alarm") | {
        "state": state_name(was),
        "id": fault.id,
        "reaction": name_of(Reaction, reaction),
        "text": fault.text,
        "cause": fault.cause,
        "next_action": fault.next_action,
        "values": {
            "torque_out_nm": round(float(from_zero(record, "torque_out_nm")), 3),
            "torque_in_nm": round(float(from_zero(record, "torque_in_nm")), 5),
            "reference_torque_nm": round(float(orders["reference_torque_nm"]), 3),
            "brake_current_a": round(float(image["brake_current_a"]), 3),
        },
    }
    code = int(image["drive_emcy_code"])
    if fault.id in DRIVE_ALARMS and code:
        told = explain_emcy(code)
        event["detail"] = f"emergency code 0x{code:04X}: {told.cause}; {told.next_action}"
    return event


def events_of(table: Table, period_ns: int, notes: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return all events in order of time; `notes` are the controller's own, as its process reported them."""
    found = [*_commands(table), *_alarms(table), *_transitions(table), *notes]
    for event in found:
        event["t_s"] = round(event["scan"] * period_ns * 1e-9, 6)
    return sorted(found, key=lambda event: int(event["scan"]))


def alarms_in(events: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the alarms among events in order of time; of the same scan, the one that caused the reaction first."""
    alarms = [event for event in events if event["kind"] == "alarm"]
    return sorted(alarms, key=lambda event: (event["scan"], not event["first"]))
