"""The tables of the controller are complete, and a changed row makes a test fail."""

from __future__ import annotations

import pytest
from programs import ROWS
from transitions import MachineError

from controller.budgets import BUDGETS
from controller.faults import FAULT_BY_ID
from controller.image import (
    IMAGE_FIELDS,
    IMAGE_STRUCT,
    ORDERS_FIELDS,
    ORDERS_STRUCT,
    DriveMode,
    DriveState,
    Image,
    Orders,
    State,
)
from controller.loading import TIMEOUT_FAULT
from controller.preparation import ENABLE_PATH
from controller.program import ROLES
from controller.states import END_STATES, TRANSITIONS, TRIGGER_INTO, Sequence

S = State

# who may lead into a state; a row that the design does not know makes this fail
ENTRIES: dict[State, set[State]] = {
    S.IDLE: {S.COMPLETE, S.STOPPED},
    S.HOME: {S.IDLE},
    S.LOCK: {S.HOME},
    S.CALIBRATE: {S.LOCK},
    S.RAMP_POS: {S.LOCK, S.CALIBRATE, S.REVERSE},
    S.REVERSE: {S.RAMP_POS, S.RAMP_NEG},
    S.RAMP_NEG: {S.REVERSE},
    S.UNLOAD: {S.LOCK, S.CALIBRATE, S.RAMP_POS, S.RAMP_NEG, S.REVERSE, S.FAULT},
    S.RELEASE: {S.HOME, S.UNLOAD},
    S.COMPLETE: {S.RELEASE},
    S.STOPPED: {S.IDLE, S.RELEASE},
    S.FAULT: set(S) - {S.FAULT},
}


def test_process_image_tables_match_the_tuples():
    assert tuple(field.name for field in IMAGE_FIELDS) == Image._fields
    assert tuple(field.name for field in ORDERS_FIELDS) == Orders._fields
    assert len(IMAGE_STRUCT.unpack(bytes(IMAGE_STRUCT.size))) == len(Image._fields)
    assert len(ORDERS_STRUCT.unpack(bytes(ORDERS_STRUCT.size))) == len(Orders._fields)
    for field in IMAGE_FIELDS + ORDERS_FIELDS:
        assert field.meaning
        if field.format == "d":
            assert field.unit, f"{field.name} is a quantity without a unit"


def test_transitions_are_those_of_the_design():
    for state, sources in ENTRIES.items():
        assert {row.source for row in TRANSITIONS if row.dest == state} == sources
    assert set(ENTRIES) == set(S)


def test_safety_rows_stand_first_and_a_fault_is_left_by_reset_alone():
    triggers = [row.trigger for row in TRANSITIONS]
    trips = triggers.count("trip")
    assert triggers[:trips] == ["trip"] * trips
    assert [row.trigger for row in TRANSITIONS if row.source == S.FAULT] == ["reset"]


def test_an_impossible_trigger_is_refused_and_changes_nothing():
    for state in State:
        allowed = {row.trigger for row in TRANSITIONS if row.source == state}
        for trigger in {row.trigger for row in TRANSITIONS} - allowed:
            sequence = Sequence()
            sequence.state = state
            with pytest.raises(MachineError):
                sequence.fire(trigger)
            assert sequence.state == state


def test_small_tables():
    assert set(TRIGGER_INTO) <= set(S)
    assert all(any(row.trigger == t and row.dest == s for row in TRANSITIONS) for s, t in TRIGGER_INTO.items())
    assert set(TIMEOUT_FAULT.values()) <= set(FAULT_BY_ID)
    assert {S.LOCK, S.CALIBRATE, S.RAMP_POS, S.RAMP_NEG, S.REVERSE, S.UNLOAD} == set(TIMEOUT_FAULT)
    assert {row[1] for row in ROWS} <= set(ROLES)
    assert all(reason for _, reason in BUDGETS.values())
    assert ENABLE_PATH.keys().isdisjoint({DriveState.FAULT, DriveState.FAULT_REACTION_ACTIVE, DriveState.UNKNOWN})
    assert {S.COMPLETE, S.STOPPED} == END_STATES
    assert {mode.value for mode in DriveMode} == {0, 6, 9, 10}
