"""What ends a run before its ramps: a start that cannot be, sensors at rest, a lock that is not proven."""

from __future__ import annotations

import pytest
from programs import short_program
from ramp_support import SHOWN, S
from timeline import Timeline

from definitions.image import (
    AGE_NEVER,
    Command,
    DriveCommand,
    DriveState,
    NmtState,
    SampleStatus,
)

START_FAULTS: dict[str, dict[str, float]] = {
    "devices_not_ready": {"sample_age_scans": AGE_NEVER, "io_age_scans": AGE_NEVER},
    "estop": {"estop_released": 0},
    "tare_out_of_range": {"torque_in_nm": 0.2},
    "drive_enable_timeout": {"drive_state": DriveState.NOT_READY_TO_SWITCH_ON},
    "homing_failed": {"drive_homing_error": 1, "drive_homing_attained": 0},
    "brake_stays_closed": {"brake_on": 1, "brake_current_a": 6.0},
}


@pytest.mark.parametrize("fault_id", sorted(START_FAULTS))
def test_a_start_that_cannot_be_is_refused_by_name(fault_id):
    run = Timeline(short_program())
    run.bench.frozen = dict(START_FAULTS[fault_id])
    run.until_finished()
    assert run.controller.state == S.FAULT
    assert run.alarms()[0] == fault_id
    assert S.LOCK not in run.states()


def test_start_waits_for_the_drive_to_be_operational():
    run = Timeline(short_program())
    run.bench.frozen = {"drive_nmt_state": NmtState.NEVER_HEARD}
    run.go(50)
    assert run.states() == [S.IDLE]
    run.bench.frozen = {}
    run.go(2)
    assert run.controller.state == S.HOME
    run.bench.frozen = {"drive_nmt_state": NmtState.PRE_OPERATIONAL}
    run.go()
    assert run.alarms() == ["drive_data_stale"]


def test_noisy_sensor_is_not_tared():
    run = Timeline(short_program())
    for k in range(60):
        run.bench.frozen = {"torque_out_nm": 11.0 * (k % 2) - 5.5}
        run.go()
    assert run.alarms() == ["tare_unsteady"]


def test_open_lock_is_not_proven():
    run = Timeline(short_program())
    run.bench.lock_holds = False
    run.until_finished()
    assert run.controller.state == S.FAULT
    assert run.alarms()[0] in ("lock_slip", "lock_unproven")
    assert S.CALIBRATE not in run.states()


def test_a_stuck_output_sensor_does_not_lead_the_lock_proof_far_beyond_its_torque():
    program = short_program()
    run = Timeline(program)
    run.until_state(S.LOCK)
    run.bench.frozen = {"torque_out_nm": 0.0}
    run.until_finished()
    assert run.controller.state == S.FAULT
    proof = (41.0 + 13.9) / 94.7
    assert max(abs(orders.drive_target_torque_nm) for orders in run.orders) <= 2.0 * proof * 1.001


def test_the_drive_is_not_enabled_again_on_a_lock_that_is_not_proven():
    run = Timeline(short_program())
    run.bench.frozen = {"torque_out_nm": 20.0}
    run.until_finished()
    assert run.alarms()[0] == "tare_out_of_range"
    run.command(Command.ACKNOWLEDGE)
    run.command(Command.RESET)
    run.go(2000)
    assert run.controller.state == S.FAULT
    after = [orders.drive_command for orders in run.orders]
    assert DriveCommand.ENABLE_OPERATION not in after


@pytest.mark.parametrize("fault_id", ["brake_link_lost", "housing_temperature"])
def test_an_unload_reaction_with_the_lock_open_applies_no_torque(fault_id):
    run = Timeline(short_program())
    run.until(lambda orders: orders.state == S.HOME and orders.drive_command == DriveCommand.START_HOMING)
    run.bench.frozen = {**SHOWN[fault_id], "torque_out_nm": 6.0, "drive_homing_attained": 0}
    run.until_finished()
    assert run.controller.state == S.FAULT
    assert max(abs(orders.drive_target_torque_nm) for orders in run.orders) == 0.0


def test_samples_that_are_not_ready_start_nothing():
    run = Timeline(short_program())
    run.bench.frozen = {"sample_status": SampleStatus.NOT_READY}
    run.until_finished()
    assert run.alarms()[0] == "devices_not_ready"


def test_brake_without_current_is_not_a_lock():
    run = Timeline(short_program())
    run.until_state(S.LOCK)
    run.bench.frozen = {"brake_current_a": 1.0}
    run.until_finished()
    assert run.alarms() == ["lock_not_closed"]
    assert max(abs(orders.drive_target_torque_nm) for orders in run.orders) == 0.0


def test_unload_during_homing_ends_the_homing():
    run = Timeline(short_program())
    run.until(lambda orders: orders.drive_command == DriveCommand.START_HOMING)
    run.bench.frozen = {"brake_age_scans": AGE_NEVER}
    orders = run.go()
    assert (orders.state, orders.drive_command) == (S.FAULT, DriveCommand.QUICK_STOP), "nothing to unload: lock open"


def test_a_dead_output_sensor_is_found_while_the_lock_is_proven():
    run = Timeline(short_program())
    run.until_state(S.LOCK)
    run.bench.frozen = {"torque_out_nm": 0.0}
    run.until_finished()
    assert run.alarms()[0] in ("torque_channels_disagree", "lock_unproven")
    assert max(abs(image.torque_in_nm) for image in run.images) * run.controller.program.ratio < 400.0
