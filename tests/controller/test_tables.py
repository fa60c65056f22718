"""The tables of the controller are complete, and a changed row makes a test fail."""

from __future__ import annotations

from types import SimpleNamespace
from typing import get_type_hints

import pytest
from programs import ROWS
from transitions import MachineError

from controller.controller import _OrdersDraft
from controller.loading import TIMEOUT_FAULT
from controller.preparation import ENABLE_PATH
from controller.states import TRANSITIONS, TRIGGER_INTO, Sequence
from definitions.faults import FAULT_BY_ID
from definitions.first_image import first_image
from definitions.image import (
    IMAGE_FIELDS,
    IMAGE_STRUCT,
    ORDERS_FIELDS,
    ORDERS_STRUCT,
    DriveMode,
    DriveState,
    Image,
    Orders,
    State,
    taker,
)
from definitions.program import ROLES
from definitions.states import OVER
from recipes.compiler.budgets import BUDGETS

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


@pytest.mark.parametrize(
    ("kind", "fields", "layout"), [(Image, IMAGE_FIELDS, IMAGE_STRUCT), (Orders, ORDERS_FIELDS, ORDERS_STRUCT)]
)
def test_rows_of_the_process_image_are_whole(kind, fields, layout):
    assert tuple(field.name for field in fields) == kind._fields
    assert layout.format == "<" + "".join(field.format for field in fields)
    types = get_type_hints(kind)
    for field in fields:
        assert field.meaning
        assert types[field.name] is (float if field.format == "d" else int)
        assert field.unit or field.format != "d", f"{field.name} is a quantity without a unit"


def test_a_draft_gives_its_values_by_name_in_whatever_order_they_were_set():
    draft = SimpleNamespace(**{name: place for place, name in reversed(list(enumerate(Orders._fields)))})
    assert taker()(draft) == Orders(*range(len(Orders._fields)))
    del draft.brake_on
    with pytest.raises(AttributeError, match="brake_on"):
        taker()(draft)


@pytest.mark.parametrize("draft", [first_image(), _OrdersDraft()])
def test_what_is_written_in_place_has_room_for_the_fields_alone(draft):
    with pytest.raises(AttributeError):
        draft.torque_of_nobody_nm = 1.0


def test_an_image_gives_its_values_in_their_order_and_a_copy_is_another_one():
    image = Image(*range(len(Image._fields)))
    assert tuple(image) == tuple(range(len(Image._fields)))
    changed = image._replace(brake_on=99)
    assert (changed.brake_on, image.brake_on) == (99, Image._fields.index("brake_on"))
    assert changed._replace(brake_on=image.brake_on) == image
    with pytest.raises(AttributeError):
        image._replace(torque_of_nobody_nm=1.0)


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
    assert {S.COMPLETE, S.STOPPED} == OVER
    assert {mode.value for mode in DriveMode} == {0, 6, 9, 10}
