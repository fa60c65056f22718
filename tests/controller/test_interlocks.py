"""Every interlock, injected into a running ramp: reaction, orders, first-out cause, latching."""

from __future__ import annotations

import itertools

import pytest
from programs import short_program
from ramp_support import ORDER_OF, SHOWN, S, mid_ramp
from timeline import Timeline

from controller.debounce import debounce_scans
from controller.interlocks import INTERLOCKS, RAISED_BY_STEPS
from definitions.faults import FAULT_BY_ID, FAULTS, cause_among
from definitions.image import (
    Command,
    DriveCommand,
    Link,
    Reaction,
)

HOLDING = sorted(fault_id for fault_id in SHOWN if FAULT_BY_ID[fault_id].reaction == Reaction.HOLD)
LATCHING = sorted(fault_id for fault_id in SHOWN if FAULT_BY_ID[fault_id].reaction >= Reaction.UNLOAD)
HELD_SCANS = 100
AFTER_SCANS = 1000
"""Scans after the end of a reaction, in which nothing may change any more."""

HELD_WITH = {"torque_out_alarm": {"torque_in_nm": 5.0}}
"""What the other channels show with it, so that they agree for as long as the hold lasts."""


def test_every_fault_that_is_shown_here_holds_or_latches():
    assert sorted([*HOLDING, *LATCHING]) == sorted(SHOWN)
    assert HOLDING


def test_every_interlock_has_a_case_here_and_every_fault_a_detector():
    assert set(SHOWN) == {row.fault for row in INTERLOCKS} - {"brake_stays_closed"}
    detectors = {row.fault for row in INTERLOCKS} | RAISED_BY_STEPS
    assert {fault.id for fault in FAULTS} == detectors
    assert all(row.live_in for row in INTERLOCKS)


def test_fault_numbers_fit_the_alarm_mask_and_are_unique():
    numbers = [fault.number for fault in FAULTS]
    assert len(set(numbers)) == len(FAULTS) == len({fault.id for fault in FAULTS})
    assert all(0 < number < 64 for number in numbers)
    assert all(fault.text and fault.cause and fault.next_action for fault in FAULTS)
    assert all(fault.reaction > Reaction.NONE for fault in FAULTS)


@pytest.mark.parametrize("fault_id", sorted(SHOWN))
def test_interlock_reacts_in_the_scan_of_its_detection(fault_id):
    fault = FAULT_BY_ID[fault_id]
    run = mid_ramp()
    run.bench.frozen = dict(SHOWN[fault_id])
    debounce = debounce_scans(fault, run.controller.program)
    if fault_id == "sample_frozen":
        debounce += 1  # the first repetition is what makes it stand still
    for _ in range(debounce):
        run.go()
        assert run.controller.state == S.RAMP_NEG, "reacted before the debounce time"
    if fault_id == "operator_quick_stop":
        run.bench.command = Command.QUICK_STOP
    orders = run.go()
    assert fault_id in run.alarms()
    if fault_id in HOLDING:
        assert (orders.state, orders.reaction, orders.fault) == (S.RAMP_NEG, Reaction.HOLD, 0)
        assert orders.drive_command == DriveCommand.ENABLE_OPERATION
        return
    assert orders.state == S.FAULT
    assert orders.fault == fault.number
    assert orders.drive_command == ORDER_OF[fault.reaction]
    if fault.reaction > Reaction.UNLOAD:
        assert orders.drive_target_torque_nm == 0.0


@pytest.mark.parametrize("fault_id", HOLDING)
def test_a_hold_freezes_the_ramp_latches_nothing_and_goes_on_when_its_cause_is_gone(fault_id):
    run = mid_ramp()
    run.bench.frozen = SHOWN[fault_id] | HELD_WITH.get(fault_id, {})
    first = run.until(lambda orders: orders.reaction == Reaction.HOLD)
    run.go(HELD_SCANS)
    held = run.orders[-HELD_SCANS:]
    assert {(one.state, one.reaction, one.fault) for one in held} == {(S.RAMP_NEG, Reaction.HOLD, 0)}
    assert {one.reference_torque_nm for one in held} == {first.reference_torque_nm}
    assert {one.drive_command for one in held} == {DriveCommand.ENABLE_OPERATION}
    run.bench.frozen = {}
    run.until_finished()
    assert (run.controller.state, run.alarms()) == (S.COMPLETE, [fault_id])


@pytest.mark.parametrize("fault_id", LATCHING)
def test_a_fault_stays_latched_with_its_first_cause_and_the_lock_stays_closed(fault_id):
    fault = FAULT_BY_ID[fault_id]
    run = mid_ramp()
    run.bench.frozen = dict(SHOWN[fault_id])
    run.bench.command = Command.QUICK_STOP if fault_id == "operator_quick_stop" else Command.NONE
    run.until_state(S.FAULT)
    run.bench.frozen = {}
    run.until_finished()
    run.go(AFTER_SCANS)
    orders = run.orders[-1]
    assert (orders.state, orders.fault) == (S.FAULT, fault.number)
    assert run.controller.finished
    assert orders.brake_on
    assert orders.drive_command == DriveCommand.DISABLE_VOLTAGE


def test_hold_freezes_the_ramp_and_goes_on_by_itself():
    run = mid_ramp()
    run.bench.frozen = {"sample_age_scans": 6}
    run.go(300)
    held = run.orders[-1].reference_torque_nm
    run.go(300)
    assert run.orders[-1].reference_torque_nm == pytest.approx(held, abs=1e-9)
    run.bench.frozen = {}
    run.until_finished()
    assert run.controller.state == S.COMPLETE


def test_unload_reaction_brings_the_torque_to_zero_and_then_switches_the_drive_off():
    run = mid_ramp()
    run.bench.frozen = {"housing_temp_c": 80.0}
    run.until_state(S.FAULT)
    run.until_finished()
    off = next(i for i, o in enumerate(run.orders) if o.state == S.FAULT and o.drive_command == 0)
    assert abs(run.images[off].torque_out_nm) < 0.02 * 412.0
    slew = run.controller.program.control.slew_nm_s * 1e-3
    torques = [o.drive_target_torque_nm for o in run.orders[:off]]
    assert max(abs(b - a) for a, b in itertools.pairwise(torques)) <= slew * 1.001


def test_the_strongest_reaction_wins_and_a_weaker_one_never_softens_it():
    run = mid_ramp()
    run.bench.frozen = {"housing_temp_c": 80.0}
    run.until_state(S.FAULT)
    run.go(20)
    assert run.orders[-1].reaction == Reaction.UNLOAD
    run.bench.frozen = {"housing_temp_c": 80.0, "estop_released": 0}
    orders = run.go()
    assert (orders.reaction, orders.drive_command) == (Reaction.POWER_OFF, DriveCommand.DISABLE_VOLTAGE)
    assert orders.fault == FAULT_BY_ID["housing_temperature"].number, "the first cause is kept"
    run.bench.frozen = {"housing_temp_c": 80.0}
    assert run.go().reaction == Reaction.POWER_OFF
    assert run.alarms() == ["housing_temperature", "estop"]


def test_several_causes_in_one_scan_name_the_most_severe():
    run = mid_ramp()
    run.bench.frozen = {"torque_out_nm": 500.0, "estop_released": 0, "links_lost": Link.AMPLIFIER}
    orders = run.go()
    assert orders.fault == FAULT_BY_ID["estop"].number
    assert set(run.alarms()) == {"estop", "torque_out_trip", "amplifier_lost"}


@pytest.mark.parametrize(
    ("raised", "cause"),
    [
        (("sample_late",), "sample_late"),
        (("housing_temperature", "missed_periods", "sample_late"), "housing_temperature"),
        (("missed_periods", "lock_unproven", "housing_temperature"), "housing_temperature"),
        (("guard_open", "brake_stays_closed", "torque_out_trip"), "brake_stays_closed"),
        (("brake_stays_closed", "estop", "can_lost"), "estop"),
    ],
)
def test_the_cause_is_the_most_severe_and_of_equals_the_lowest_number(raised: tuple[str, ...], cause: str):
    assert cause_among(sum(1 << FAULT_BY_ID[name].number for name in raised)).id == cause


def test_without_an_alarm_there_is_no_cause():
    with pytest.raises(ValueError, match="empty"):
        cause_among(0)


def test_unloading_by_a_stuck_sensor_does_not_load_the_other_side():
    run = mid_ramp()
    stuck = run.bench.image.torque_out_nm
    run.bench.frozen = {"torque_out_nm": stuck, "housing_temp_c": 80.0}
    run.until_state(S.FAULT)
    before = len(run.orders)
    run.until_finished()
    lowest = min(orders.drive_target_torque_nm for orders in run.orders[before:])
    assert lowest >= -0.08 * 5.5 * 1.001


@pytest.mark.parametrize("state", [S.IDLE, S.FAULT])
def test_quick_stop_is_heard_in_every_state(state):
    run = mid_ramp() if state == S.FAULT else Timeline(short_program(), start=False)
    if state == S.FAULT:
        run.bench.frozen = {"housing_temp_c": 80.0}
        run.until_state(S.FAULT)
    run.go(5)
    orders = run.command(Command.QUICK_STOP)
    assert (orders.state, orders.reaction) == (S.FAULT, Reaction.QUICK_STOP)
    assert orders.drive_command != DriveCommand.ENABLE_OPERATION


def test_ramp_that_does_not_arrive_ends_in_time():
    run = Timeline(short_program())
    run.until_state(S.RAMP_NEG)
    run.bench.frozen = {"torque_out_nm": 300.0}
    run.until_finished()
    assert run.controller.state == S.FAULT


def test_a_hold_up_is_named_as_such_and_not_as_silent_devices():
    run = mid_ramp()
    run.bench.frozen = {"missed_periods": 25, "drive_age_scans": 26, "sample_age_scans": 26}
    run.go()
    assert run.alarms() == ["missed_periods"]
    run = mid_ramp()
    run.bench.frozen = {"missed_periods": 15, "drive_age_scans": 16, "sample_age_scans": 16}
    run.go()
    run.bench.frozen = {}
    run.until_finished()
    assert (run.controller.state, run.alarms()) == (S.COMPLETE, [])


def test_torque_channels_of_opposite_sign_disagree_at_once():
    run = mid_ramp()
    run.bench.frozen = {"torque_out_nm": -200.0}
    run.go(debounce_scans(FAULT_BY_ID["torque_channels_disagree"], run.controller.program) + 1)
    assert run.alarms() == ["torque_channels_disagree"]
