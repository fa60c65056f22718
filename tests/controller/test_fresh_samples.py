"""An old torque decides nothing: no lock opens, no drive comes on and no rest is read from a sample that is late."""

from __future__ import annotations

import pytest
from bench_model import READY
from programs import short_program
from ramp_support import S, mid_ramp
from timeline import Timeline

from controller.sample import is_fresh, shown_torque_nm, tared_nm
from definitions.image import AGE_NEVER, Command, DriveCommand, DriveState

PROGRAM = short_program()
LATE = {"sample_age_scans": PROGRAM.limits.sample_late_scans + 1}
"""Older than a sample of now, and not yet a fault."""


def wound_up_after_a_reset() -> Timeline:
    """A run whose fault was reset with torque in the unit: what follows is the way to zero."""
    run = mid_ramp()
    run.bench.frozen = {"estop_released": 0, "torque_out_nm": 25.0}
    run.until_finished()
    run.bench.frozen = {"torque_out_nm": 25.0}
    run.command(Command.ACKNOWLEDGE)
    run.command(Command.RESET)
    return run


def test_late_is_older_than_fresh_and_younger_than_stale() -> None:
    limits = PROGRAM.limits
    assert is_fresh(READY._replace(sample_age_scans=limits.sample_late_scans), limits)
    assert not is_fresh(READY._replace(**LATE), limits)
    assert LATE["sample_age_scans"] <= limits.sample_stale_scans


def test_a_drive_is_not_enabled_on_an_old_torque() -> None:
    run = wound_up_after_a_reset()
    run.bench.frozen |= LATE
    run.until_state(S.UNLOAD)
    run.go(PROGRAM.enable_scans - 10)
    assert run.controller.state == S.UNLOAD
    assert run.orders[-1].brake_on
    assert all(o.drive_command == DriveCommand.DISABLE_VOLTAGE for o in run.orders if o.state == S.UNLOAD)
    run.bench.frozen = {"torque_out_nm": 25.0}
    run.until(lambda orders: orders.drive_command == DriveCommand.ENABLE_OPERATION, 10)


def test_a_low_torque_of_an_old_sample_does_not_lead_to_the_release_and_not_to_a_fault() -> None:
    run = wound_up_after_a_reset()
    run.bench.frozen = {"torque_out_nm": 0.0} | LATE
    run.until_state(S.UNLOAD)
    run.go(PROGRAM.enable_scans - 10)
    assert run.controller.state == S.UNLOAD
    run.bench.frozen = {}
    run.until_state(S.RELEASE)


def test_the_wait_for_a_fresh_sample_has_an_end() -> None:
    run = wound_up_after_a_reset()
    run.bench.frozen |= LATE
    run.until_state(S.UNLOAD)
    run.until(lambda orders: orders.state == S.FAULT, run.controller.program.enable_scans + 2)
    assert [event.text for event in run.events if event.kind == "alarm"][-1] == "unload_failed"


def test_the_rest_of_an_unloading_is_read_from_a_fresh_sample() -> None:
    run = Timeline(PROGRAM)
    run.until_state(S.UNLOAD)
    run.until(lambda orders: orders.drive_target_torque_nm == 0.0)
    run.bench.frozen = dict(LATE)
    run.go(PROGRAM.enable_scans - 10)
    assert run.controller.state == S.UNLOAD
    run.bench.frozen = {}
    run.until_state(S.RELEASE)
    assert run.bench.image.drive_state == DriveState.OPERATION_ENABLED


@pytest.mark.parametrize("from_input", [False, True])
def test_what_is_shown_is_tared_and_never_old(from_input: bool) -> None:  # noqa: FBT001 - a case
    program = short_program(from_input=from_input)
    run = Timeline(program)
    orders = run.until_state(S.RAMP_POS)._replace(torque_out_tare_nm=2.5, torque_in_tare_nm=0.5)
    image = run.images[-1]._replace(torque_out_nm=10.0, torque_in_nm=1.0)
    assert tared_nm(image, orders) == (0.5, 7.5)
    assert shown_torque_nm(image, orders, program) == (7.5 if program.has_torque_out else orders.controlled_torque_nm)
    stale = image._replace(sample_age_scans=program.limits.sample_stale_scans + 1)
    assert shown_torque_nm(stale, orders, program) is None
    assert shown_torque_nm(image._replace(sample_age_scans=AGE_NEVER), orders, program) is None
