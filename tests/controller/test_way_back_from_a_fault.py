"""The recovery from a fault: acknowledgement, reset, and a unit that is unloaded before its lock opens."""

from __future__ import annotations

import itertools

from programs import short_program
from ramp_support import S, mid_ramp
from timeline import Timeline

from controller.aftermath import FaultReaction
from definitions.image import (
    AGE_NEVER,
    Command,
    DriveCommand,
    DriveState,
)


def test_way_back_needs_the_cause_gone_an_acknowledgement_and_a_reset():
    run = mid_ramp()
    run.bench.frozen = {"estop_released": 0}
    run.until_finished()
    run.command(Command.RESET)
    run.go(300)
    assert run.controller.state == S.FAULT, "not acknowledged"
    run.command(Command.ACKNOWLEDGE)
    run.command(Command.RESET)
    run.go(300)
    assert run.controller.state == S.FAULT, "cause still there"
    run.bench.frozen = {}
    run.go(300)
    assert run.controller.state == S.FAULT, "nothing clears by itself"
    run.command(Command.RESET)
    run.until(lambda orders: orders.state == S.STOPPED)
    assert run.states()[-4:] == [S.FAULT, S.UNLOAD, S.RELEASE, S.STOPPED]
    assert run.orders[-1].fault == 0


def test_reset_gives_the_drive_a_rising_edge_on_the_fault_bit():
    run = mid_ramp()
    run.bench.image = run.bench.image._replace(drive_state=DriveState.FAULT)
    run.until_finished()
    run.command(Command.ACKNOWLEDGE)
    run.command(Command.RESET)
    run.until(lambda orders: orders.state == S.STOPPED)
    commands = [orders.drive_command for orders in run.orders]
    first = commands.index(DriveCommand.FAULT_RESET)
    assert commands[first - 1] == DriveCommand.DISABLE_VOLTAGE
    assert commands.count(DriveCommand.FAULT_RESET) == 1


def reset_from_drive_fault(write) -> Timeline:
    """A run whose drive is in fault, and is reset; `write` is what the drive makes of each scan's orders in fault."""
    run = mid_ramp()
    run.bench.image = run.bench.image._replace(drive_state=DriveState.FAULT)
    run.until_finished()
    stored = run.bench.write
    run.bench.write = lambda orders: stored(
        write(orders) if run.bench.image.drive_state == DriveState.FAULT else orders
    )
    run.command(Command.ACKNOWLEDGE)
    run.command(Command.RESET)
    return run


def test_a_drive_that_reads_its_control_word_every_5_ms_is_reset():
    scans = itertools.count()
    run = reset_from_drive_fault(
        lambda orders: orders if next(scans) % 5 == 4 else orders._replace(drive_command=DriveCommand.DISABLE_VOLTAGE)
    )
    run.until(lambda orders: orders.state == S.STOPPED)


def test_a_drive_that_stays_in_fault_is_given_the_edge_again_and_again_and_no_longer_than_it_may_take():
    run = reset_from_drive_fault(lambda orders: orders._replace(drive_command=DriveCommand.DISABLE_VOLTAGE))
    run.until(lambda orders: orders.phase == FaultReaction.SETTLED)
    bits = [orders.drive_command == DriveCommand.FAULT_RESET for orders in run.orders]
    stretches = [len(list(some)) for bit, some in itertools.groupby(bits) if bit]
    assert len(stretches) > 1
    assert all(one * run.controller.program.period_s >= 0.05 for one in stretches[:-1])
    assert not bits[-1]
    assert sum(stretches) < run.controller.program.enable_scans
    assert any("stays in fault" in event.text for event in run.events)


def test_a_wound_up_unit_is_unloaded_before_the_lock_opens_after_a_reset():
    program = short_program()
    run = Timeline(program)
    run.until_state(S.RAMP_NEG)
    run.until(lambda orders: orders.controlled_torque_nm < 200.0)
    run.bench.frozen = {"estop_released": 0, "torque_out_nm": 25.0}  # what friction keeps after the power went
    run.until_finished()
    run.bench.frozen = {}
    run.bench.image = run.bench.image._replace(torque_out_nm=25.0)
    stored = run.bench.write
    run.bench.write = lambda orders: (stored(orders), keep(run, orders))[0]
    run.command(Command.ACKNOWLEDGE)
    run.command(Command.RESET)
    run.until(lambda orders: orders.state == S.STOPPED)
    unload = [o for o in run.orders if o.state == S.UNLOAD]
    assert any(o.drive_target_torque_nm < 0.0 for o in unload), "friction is crossed by the drive"
    opened = next(i for i in range(1, len(run.orders)) if run.orders[i - 1].brake_on and not run.orders[i].brake_on)
    assert abs(run.images[opened].torque_out_nm) <= program.release_torque_nm


def keep(run: Timeline, orders) -> None:
    """A disabled drive leaves the torque that friction holds; the model forgets it."""
    if run.bench.image.drive_state != DriveState.OPERATION_ENABLED and orders.state in (S.FAULT, S.UNLOAD):
        run.bench.image = run.bench.image._replace(torque_out_nm=25.0)


def test_another_cause_after_the_acknowledgement_wants_its_own():
    run = mid_ramp()
    run.bench.frozen = {"estop_released": 0}
    run.until_finished()
    run.bench.frozen = {}
    run.command(Command.ACKNOWLEDGE)
    run.bench.frozen = {"guard_closed": 0}
    run.go()
    run.bench.frozen = {}
    run.command(Command.RESET)
    run.go(300)
    assert run.controller.state == S.FAULT, "nobody has acknowledged the guard"
    run.command(Command.ACKNOWLEDGE)
    run.command(Command.RESET)
    run.until(lambda orders: orders.state == S.STOPPED)


def test_a_drive_that_shows_a_wild_torque_does_not_get_it_as_set_point():
    program = short_program(speed_rad_s=0.2)
    run = Timeline(program)
    run.until_state(S.RAMP_NEG)
    run.go(100)
    run.bench.frozen = {"drive_torque_nm": 80.0, "brake_age_scans": AGE_NEVER}
    orders = run.go()
    assert orders.state == S.FAULT
    assert abs(orders.drive_target_torque_nm) <= program.control.torque_limit_nm


def test_the_way_back_starts_its_torque_from_zero():
    program = short_program()
    run = Timeline(program)
    run.until_state(S.RAMP_NEG)
    run.until(lambda orders: orders.controlled_torque_nm < 400.0)
    run.bench.frozen = {"estop_released": 0, "torque_out_nm": 25.0}
    run.until_finished()
    stored = run.bench.write
    run.bench.write = lambda orders: (stored(orders), keep(run, orders))[0]
    run.bench.frozen = {}
    run.bench.image = run.bench.image._replace(torque_out_nm=25.0)
    run.command(Command.ACKNOWLEDGE)
    run.command(Command.RESET)
    run.until(lambda orders: orders.state == S.STOPPED)
    unload = [orders.drive_target_torque_nm for orders in run.orders if orders.state == S.UNLOAD]
    slew_nm = program.control.slew_nm_s * program.period_s
    assert max(abs(b - a) for a, b in itertools.pairwise([0.0, *unload])) <= slew_nm * 1.001


def test_a_drive_that_does_not_switch_off_is_told_and_nothing_goes_on_with_it():
    """With a set-point that no longer arrives it stays on while the lock is closed, and only its state says so."""
    run = mid_ramp()
    run.bench.frozen = {"guard_closed": 0, "drive_state": DriveState.OPERATION_ENABLED}
    run.until_finished()
    assert run.controller.state == S.FAULT
    assert [event.text for event in run.events if "switch its power off" in event.text]
    run.bench.frozen = {"drive_state": DriveState.OPERATION_ENABLED}
    run.command(Command.ACKNOWLEDGE)
    run.command(Command.RESET)
    run.until(lambda orders: orders.phase == FaultReaction.SETTLED)
    assert [event.text for event in run.events if event.text.startswith("reset refused")]
    assert run.controller.state == S.FAULT
    run.bench.frozen = {}
    run.go(50)
    run.command(Command.RESET)
    run.until(lambda orders: orders.state == S.STOPPED)
