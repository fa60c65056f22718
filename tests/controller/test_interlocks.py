"""Every interlock, injected into a running ramp: reaction, orders, first-out cause, latching."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import cache

import pytest
from bench_model import READY
from programs import short_program
from timeline import Timeline

from controller.debounce import DEBOUNCE_TIMES, debounce_scans
from controller.faults import FAULT_BY_ID, FAULTS
from controller.image import (
    AGE_NEVER,
    Command,
    DriveCommand,
    DriveState,
    Link,
    NmtState,
    Reaction,
    SampleStatus,
    State,
)
from controller.interlocks import INTERLOCKS, RAISED_BY_STEPS, Measured, Watch

S = State

# fault -> what the image shows; the condition is put on in the middle of a ramp with about +200 N·m on the unit
SHOWN: dict[str, dict[str, float]] = {
    "estop": {"estop_released": 0},
    "guard_open": {"guard_closed": 0},
    "operator_quick_stop": {},
    "can_lost": {"links_lost": Link.CAN},
    "drive_heartbeat_lost": {"drive_heartbeat_age_scans": 101},
    "drive_data_stale": {"drive_age_scans": 11},
    "amplifier_lost": {"links_lost": Link.AMPLIFIER},
    "sample_stale": {"sample_age_scans": 11},
    "sample_late": {"sample_age_scans": 6},
    "sample_frozen": {"sample_counter": 7},
    "brake_link_lost": {"brake_age_scans": AGE_NEVER},
    "remote_io_lost": {"links_lost": Link.REMOTE_IO},
    "drive_fault": {"drive_state": DriveState.FAULT},
    "drive_emergency": {"drive_emcy_code": 0x8130},
    "drive_dropped_out": {"drive_state": DriveState.SWITCH_ON_DISABLED},
    "drive_mode_refused": {"drive_mode": 9},
    "drive_internal_limit": {"drive_internal_limit": 1},
    "torque_out_trip": {"torque_out_nm": 495.0},
    "torque_in_trip": {"torque_in_nm": -5.5},
    "torque_out_alarm": {"torque_out_nm": 475.0},
    "overspeed": {"drive_velocity_rad_s": -6.3},
    "over_travel": {"angle_in_rad": 1.2},
    "lock_slip": {"angle_out_rad": 1e-3},
    "brake_current_lost": {"brake_current_a": 5.0},
    "housing_temperature": {"housing_temp_c": 61.0},
    "missed_periods": {"missed_periods": 21},
    "sensor_not_a_number": {"torque_out_nm": math.nan},
    "sensor_saturated": {"sample_status": SampleStatus.TORQUE_OUT_SATURATED},
    "torque_channels_disagree": {"torque_in_nm": 0.0, "torque_out_nm": 400.0},
    "sample_not_ready": {"sample_status": SampleStatus.NOT_READY},
    "drive_not_following": {"drive_follows_command": 0},
    "angle_channels_disagree": {"drive_angle_rad": 40.3},
}

ORDER_OF = {
    Reaction.UNLOAD: DriveCommand.ENABLE_OPERATION,
    Reaction.QUICK_STOP: DriveCommand.QUICK_STOP,
    Reaction.POWER_OFF: DriveCommand.DISABLE_VOLTAGE,
}


@cache
def _in_ramp() -> Timeline:
    run = Timeline(short_program())
    run.until_state(S.RAMP_NEG)
    run.until(lambda orders: orders.controlled_torque_nm < 200.0)
    return run


def mid_ramp() -> Timeline:
    return _in_ramp().branch()


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
    if fault.reaction == Reaction.HOLD:
        assert (orders.state, orders.reaction) == (S.RAMP_NEG, Reaction.HOLD)
        return
    assert orders.state == S.FAULT
    assert orders.fault == fault.number
    assert orders.drive_command == ORDER_OF[fault.reaction]
    assert fault_id in run.alarms()
    if fault.reaction > Reaction.UNLOAD:
        assert orders.drive_target_torque_nm == 0.0


@pytest.mark.parametrize("fault_id", sorted(SHOWN))
def test_a_fault_stays_latched_with_its_first_cause_and_the_lock_stays_closed(fault_id):
    fault = FAULT_BY_ID[fault_id]
    if fault.reaction < Reaction.UNLOAD:
        return
    run = mid_ramp()
    run.bench.frozen = dict(SHOWN[fault_id])
    run.bench.command = Command.QUICK_STOP if fault_id == "operator_quick_stop" else Command.NONE
    run.until_state(S.FAULT)
    run.bench.frozen = {}
    run.go(8000)
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


def test_unloading_by_a_stuck_sensor_does_not_load_the_other_side():
    run = mid_ramp()
    stuck = run.bench.image.torque_out_nm
    run.bench.frozen = {"torque_out_nm": stuck, "housing_temp_c": 80.0}
    run.until_state(S.FAULT)
    before = len(run.orders)
    run.until_finished()
    lowest = min(orders.drive_target_torque_nm for orders in run.orders[before:])
    assert lowest >= -0.08 * 5.5 * 1.001


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


def test_unload_during_homing_ends_the_homing():
    run = Timeline(short_program())
    run.until(lambda orders: orders.drive_command == DriveCommand.START_HOMING)
    run.bench.frozen = {"brake_age_scans": AGE_NEVER}
    orders = run.go()
    assert (orders.state, orders.drive_command) == (S.FAULT, DriveCommand.QUICK_STOP), "nothing to unload: lock open"


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


def test_a_reset_does_not_give_a_counting_condition_new_time():
    run = mid_ramp()
    run.bench.frozen = {"estop_released": 0}
    run.until_finished()
    run.bench.frozen = {}
    run.command(Command.ACKNOWLEDGE)
    run.bench.frozen = {"drive_velocity_rad_s": 6.3}
    run.go()
    run.command(Command.RESET)
    orders = run.go()
    assert orders.state == S.FAULT
    assert "overspeed" in run.alarms()


def test_a_debounce_time_is_the_same_time_in_every_recipe():
    program = short_program()
    for name, milliseconds in (("torque_channels_disagree", 20), ("drive_not_following", 10)):
        for period_s in (0.0005, 0.001, 0.002, 0.004):
            scans = debounce_scans(FAULT_BY_ID[name], replace(program, period_s=period_s))
            assert scans == max(2, math.ceil(round(milliseconds / (period_s * 1000.0), 6))), (name, period_s)


def test_a_debounce_stands_in_one_place():
    assert {fault.id for fault in FAULTS if fault.debounce_scans}.isdisjoint(DEBOUNCE_TIMES)
    assert set(DEBOUNCE_TIMES) <= {row.fault for row in INTERLOCKS}


FLICKERING = sorted({"angle_channels_disagree", "sample_not_ready", "torque_channels_disagree", "drive_not_following"})


@pytest.mark.parametrize("fault_id", FLICKERING)
@pytest.mark.parametrize("bad", [3, 20])
def test_what_is_wrong_most_of_the_time_is_seen(fault_id, bad):
    run = mid_ramp()
    scans = debounce_scans(FAULT_BY_ID[fault_id], run.controller.program)
    for scan in range(2 * scans + 2):
        run.bench.frozen = dict(SHOWN[fault_id]) if scan % (bad + 1) < bad else {}
        run.go()
    assert run.alarms() == [fault_id]


def test_a_spoiled_sample_now_and_then_stops_nothing_and_is_forgotten():
    run = mid_ramp()
    for scan in range(200):
        run.bench.frozen = dict(SHOWN["sample_not_ready"]) if scan % 2 else {}
        run.go()
    assert run.alarms() == []
    assert run.controller.state == S.RAMP_NEG
    run.bench.frozen = {}
    run.go(3)
    assert not any(run.controller._watch._counts)


def test_one_new_sample_says_that_they_are_not_frozen():
    """An amplifier that has a new sample in every fourth scan only, which an allowed age of 10 scans permits."""
    run = mid_ramp()
    for scan in range(100):
        run.bench.frozen = {"sample_counter": scan // 4}
        run.go()
    assert run.alarms() == []


def test_a_condition_that_lasted_for_long_is_not_held_against_the_unit_for_as_long():
    program = short_program()
    watch, measured = Watch(program), Measured()
    bad, number = READY._replace(**SHOWN["sample_not_ready"]), FAULT_BY_ID["sample_not_ready"].number
    scans = debounce_scans(FAULT_BY_ID["sample_not_ready"], program)
    for _ in range(1000):
        watch.look(bad, measured, S.FAULT)
    assert watch.active == 1 << number
    for _ in range(scans + 1):
        watch.look(READY, measured, S.FAULT)
        assert not watch.active
    for _ in range(scans):
        assert watch.look(bad, measured, S.FAULT) == Reaction.NONE


def test_bad_samples_are_borne_for_20_ms_at_most():
    limits = replace(short_program().limits, sample_stale_scans=10_000, sample_late_scans=5_000)
    for name in ("sample_frozen", "sample_not_ready"):
        for period_s, scans in ((0.001, 20), (0.002, 10), (0.0005, 40), (0.02, 2)):
            program = replace(short_program(), limits=limits, period_s=period_s)
            assert debounce_scans(FAULT_BY_ID[name], program) == scans, (name, period_s)
        assert debounce_scans(FAULT_BY_ID[name], short_program()) < 20


def test_samples_that_do_not_come_are_stale_not_frozen():
    run = mid_ramp()
    stale_scans = run.controller.program.limits.sample_stale_scans
    for age in range(1, 3 * stale_scans):
        run.bench.frozen = {"sample_counter": 7, "sample_age_scans": age}
        run.go()
    assert run.alarms() == ["sample_late", "sample_stale"]


def test_torque_channels_of_opposite_sign_disagree_at_once():
    run = mid_ramp()
    run.bench.frozen = {"torque_out_nm": -200.0}
    run.go(debounce_scans(FAULT_BY_ID["torque_channels_disagree"], run.controller.program) + 1)
    assert run.alarms() == ["torque_channels_disagree"]


def test_a_dead_output_sensor_is_found_while_the_lock_is_proven():
    run = Timeline(short_program())
    run.until_state(S.LOCK)
    run.bench.frozen = {"torque_out_nm": 0.0}
    run.until_finished()
    assert run.alarms()[0] in ("torque_channels_disagree", "lock_unproven")
    assert max(abs(image.torque_in_nm) for image in run.images) * run.controller.program.ratio < 400.0
