"""The sequence of a run, seen as timelines."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest
from programs import PEAK_NM, short_program
from ramp_support import entered, whole_run
from timeline import Timeline

from controller.aftermath import Rest
from controller.controller import Controller
from definitions.image import ORDERS_STRUCT, Command, DriveCommand, DriveState, Reaction, State

S = State
FULL_RUN = [
    S.IDLE, S.HOME, S.LOCK, S.CALIBRATE, S.RAMP_POS, S.REVERSE, S.RAMP_NEG, S.REVERSE, S.RAMP_POS, S.REVERSE,
    S.UNLOAD, S.RELEASE, S.COMPLETE,
]  # fmt: skip


@pytest.mark.parametrize("options", [{}, {"from_input": True}, {"speed_rad_s": 0.2}], ids=["torque", "input", "speed"])
def test_run_goes_through_all_states_and_completes(options):
    run = Timeline(short_program(**options))
    run.bench.image = run.bench.image._replace(sample_age_scans=50)
    run.go(5)
    assert run.controller.state == S.IDLE, "a run must not start on stale samples"
    run.bench.image = run.bench.image._replace(sample_age_scans=1)
    run.until_finished()
    assert run.states() == FULL_RUN
    assert run.alarms() == []
    peak = max(orders.controlled_torque_nm for orders in run.orders)
    assert peak == pytest.approx(PEAK_NM, rel=0.05)


def test_nothing_moves_without_a_start():
    run = Timeline(short_program(), start=False)
    run.go(2000)
    assert run.states() == [S.IDLE]
    assert {orders.drive_command for orders in run.orders} == {DriveCommand.DISABLE_VOLTAGE}


def test_no_torque_before_the_lock_is_closed_and_no_ramp_before_it_is_proven():
    program, run = short_program(), whole_run()
    for image, orders in zip(run.images, run.orders, strict=True):
        if orders.drive_target_torque_nm or orders.drive_target_velocity_rad_s:
            assert image.brake_on
            assert image.brake_current_a > program.lock.current_a - program.lock.tolerance_a
    proven = next(event.scan for event in run.events if event.text == "lock proven")
    first_ramp = next(i for i, orders in enumerate(run.orders) if orders.state == S.CALIBRATE)
    assert proven <= first_ramp


def test_lock_opens_only_with_low_torque_and_the_drive_off():
    program, run = short_program(), whole_run()
    opened = next(i for i in range(1, len(run.orders)) if run.orders[i - 1].brake_on and not run.orders[i].brake_on)
    assert run.orders[opened].state == S.RELEASE
    assert abs(run.images[opened].torque_out_nm) <= program.release_torque_nm
    assert run.images[opened].drive_state == DriveState.SWITCH_ON_DISABLED


@pytest.mark.parametrize("options", [{}, {"speed_rad_s": 0.2}], ids=["torque", "speed"])
def test_set_points_are_continuous_in_value_and_rate(options):
    program, run = short_program(**options), whole_run(**options)
    slew = program.control.slew_nm_s * program.period_s
    active = [o for o in run.orders if o.state in (S.LOCK, S.CALIBRATE, S.RAMP_POS, S.REVERSE, S.RAMP_NEG, S.UNLOAD)]
    torques = [o.drive_target_torque_nm for o in active]
    speeds = [o.drive_target_velocity_rad_s for o in active]
    if not options:
        assert max(abs(b - a) for a, b in itertools.pairwise(torques)) <= slew * 1.001
    assert max(abs(b - a) for a, b in itertools.pairwise(speeds)) <= 2.0 * program.period_s * 1.001
    references = [o.reference_torque_nm for o in active]
    if not options:
        rates = [b - a for a, b in itertools.pairwise(references)]
        rate_steps = [abs(b - a) for a, b in itertools.pairwise(rates)]
        # a rate of 800 N·m/s is reached in 0.15 s; slowing down in the window before the friction may be twice as quick
        assert max(rate_steps) <= 800.0 / 0.15 * program.period_s**2 * 40.0
        assert max(abs(rate) for rate in rates) <= 800.0 * program.period_s * 1.001


@pytest.mark.parametrize("state", [S.HOME, S.LOCK, S.CALIBRATE, S.RAMP_POS, S.REVERSE, S.RAMP_NEG])
def test_operator_stop_unloads_releases_and_ends_stopped(state):
    run = entered(state)
    run.go(20)
    run.command(Command.STOP)
    run.until_finished()
    assert run.controller.state == S.STOPPED
    assert run.alarms() == []
    assert run.states()[-2] == S.RELEASE
    assert not run.orders[-1].brake_on
    assert run.orders[-1].drive_command == DriveCommand.DISABLE_VOLTAGE


@pytest.mark.parametrize("state", [S.UNLOAD, S.RELEASE])
def test_stop_during_the_end_of_a_run_ends_stopped_too(state):
    run = entered(state)
    run.command(Command.STOP)
    run.until_finished()
    assert run.controller.state == S.STOPPED


def test_second_stop_is_a_quick_stop_with_its_own_cause():
    run = entered(S.RAMP_NEG)
    run.go(100)
    run.command(Command.STOP)
    orders = run.command(Command.QUICK_STOP)
    assert (orders.state, orders.reaction) == (S.FAULT, Reaction.QUICK_STOP)
    assert orders.drive_command == DriveCommand.QUICK_STOP
    assert run.alarms() == ["operator_quick_stop"]


def test_a_new_run_needs_a_reset_and_a_start():
    run = whole_run().branch()
    run.command(Command.START)
    run.go(10)
    assert run.controller.state == S.COMPLETE
    run.command(Command.RESET)
    assert run.controller.state == S.IDLE
    run.command(Command.START)
    run.until_finished()
    assert run.states() == [*FULL_RUN[1:], *FULL_RUN]


def test_both_torque_zeroes_are_recorded_again_when_the_lock_has_let_go():
    program, run = short_program(), whole_run()
    at_rest = [orders for orders in run.orders if orders.state == S.COMPLETE]
    phases = [orders.phase for orders in at_rest]
    assert phases == sorted(phases)
    assert phases.count(Rest.LETTING_GO) == program.let_go_scans
    assert phases.count(Rest.ZEROES) >= program.tare.samples
    assert phases[-1] == Rest.DONE
    assert not any(orders.brake_on or orders.drive_target_torque_nm for orders in at_rest)


def test_a_run_ends_without_new_samples_too():
    run = entered(S.COMPLETE)
    run.bench.frozen = {"sample_counter": 7}
    run.until_finished()
    assert run.orders[-1].phase == Rest.DONE


def test_same_images_give_the_same_orders_byte_for_byte():
    program, run = short_program(), whole_run()
    again = Controller(program)
    for scan, (image, orders) in enumerate(zip(run.images, run.orders, strict=True)):
        assert ORDERS_STRUCT.pack(*again.step(image, scan)) == ORDERS_STRUCT.pack(*orders)


def test_missed_periods_do_not_make_a_set_point_jump():
    program, run = short_program(), entered(S.RAMP_NEG)
    run.go(200)
    before = run.orders[-1].drive_target_torque_nm
    run.bench.frozen = {"missed_periods": 15}
    after = run.go().drive_target_torque_nm
    assert abs(after - before) <= program.control.slew_nm_s * program.period_s


def test_a_torque_ratio_that_cannot_be_determined_is_a_fault():
    program = short_program()
    # the interlock that compares both torques would be first: it is out of the way here
    limits = replace(program.limits, torque_agreement_nm=1e6)
    run = Timeline(replace(program, control=replace(program.control, measure_ratio=True), limits=limits))
    run.until_state(S.CALIBRATE)
    run.bench.frozen = {"torque_in_nm": run.orders[-1].torque_in_tare_nm}
    run.until_finished()
    assert run.alarms() == ["calibration_failed"]
    assert run.states()[-2:] == [S.CALIBRATE, S.FAULT]
