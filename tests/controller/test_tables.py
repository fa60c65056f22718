"""The tables of the controller are complete, and a changed row makes a test fail."""

from __future__ import annotations

import dataclasses
import math
import random
from functools import reduce
from operator import or_
from types import SimpleNamespace
from typing import get_type_hints

import pytest
from bench_model import READY
from programs import LIMITS, ROWS, short_program
from transitions import MachineError

from controller.beyond_limits import BeyondLimits
from controller.conditions import KINDS, Measured
from controller.controller import _OrdersDraft
from controller.interlocks import INTERLOCKS
from controller.loading import TIMEOUT_FAULT
from controller.preparation import ENABLE_PATH
from controller.states import TRANSITIONS, TRIGGER_INTO, Sequence
from definitions.faults import FAULT_BY_ID, bit_of
from definitions.first_image import first_image
from definitions.image import (
    IMAGE_FIELDS,
    IMAGE_STRUCT,
    ORDERS_FIELDS,
    ORDERS_STRUCT,
    Command,
    DriveMode,
    DriveState,
    Image,
    NmtState,
    Orders,
    SampleStatus,
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
    S.STOPPED: {S.IDLE, S.RELEASE, S.JOG},
    S.JOG: {S.IDLE},
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


# of each field, whether it is in order or not: what makes the conditions come and go
STRANGE: dict[str, tuple[float, ...]] = {
    "command": (Command.NONE, Command.QUICK_STOP),
    "estop_released": (0, 1),
    "guard_closed": (0, 1),
    "links_lost": tuple(range(32)),
    "drive_nmt_state": (NmtState.OPERATIONAL, NmtState.PRE_OPERATIONAL),
    "drive_state": (DriveState.OPERATION_ENABLED, DriveState.SWITCHED_ON, DriveState.FAULT),
    "drive_mode": (DriveMode.CYCLIC_SYNC_TORQUE, DriveMode.HOMING),
    "drive_emcy_code": (0, 0x8130),
    "drive_internal_limit": (0, 1),
    "drive_follows_command": (0, 1),
    "drive_torque_nm": (0.0, 1e6),
    "torque_out_nm": (0.0, 400.0, math.nan),
    "drive_angle_rad": (0.0, 40.0),
    "sample_age_scans": (0, 6),
    "sample_status": (0, *SampleStatus),
    "brake_on": (0, 1),
    "brake_current_a": (0.0, 20.0),
}
EXPECTED: dict[str, tuple[float, ...]] = {
    "counter_stands": (False, True),
    "drive_enabled_expected": (False, True),
    "mode_expected": (0, DriveMode.CYCLIC_SYNC_TORQUE),
    "agreement_live": (False, True),
    "brake_current_expected_a": (0.0, 10.0),
    "locked_motion_rad": (0.0, 1.0),
    "lock_motion_limit_rad": (0.1, math.inf),
}


def test_each_kind_of_condition_answers_with_all_of_its_bits_and_no_others():
    dice, answered = random.Random(1), dict.fromkeys(KINDS, 0)  # noqa: S311 - the same images each time
    program = short_program()
    for loading_input in (True, False):
        for _ in range(2000):
            image = READY._replace(**{name: dice.choice(values) for name, values in STRANGE.items()})
            measured = Measured()
            for name, values in EXPECTED.items():
                setattr(measured, name, dice.choice(values))
            measured.torque_out_nm, measured.drive_apart_rad = image.torque_out_nm, image.drive_angle_rad
            loaded = dataclasses.replace(program, loading_input=loading_input)
            for kind in KINDS:
                answered[kind] |= kind.test(image, measured, program.limits, loaded)
    assert {kind.test.__name__: found ^ kind.bits for kind, found in answered.items() if found != kind.bits} == {}


def test_every_interlock_is_looked_for_by_one_kind_or_against_a_limit():
    of_kinds = [kind.bits for kind in KINDS]
    assert sum(of_kinds) == reduce(or_, of_kinds)  # no bit is of two kinds
    interlocks = {row.fault for row in INTERLOCKS}
    assert reduce(or_, of_kinds) | BeyondLimits(LIMITS).bits == sum(bit_of(fault) for fault in interlocks)
