"""Drive and angle sensor of the loaded shaft: what they may differ by, and what stands still, slips or is wrong."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from bench_model import READY, freeze_limits
from hypothesis import given
from hypothesis import strategies as st
from programs import ARCMIN, LIMITS, short_program
from timeline import Timeline

from controller.conditions import Measured
from controller.context import Context
from controller.debounce import debounce_scans
from controller.interlocks import Watch
from definitions.faults import FAULT_BY_ID
from definitions.image import Command, Reaction, State
from definitions.program import Program

S = State
FAULT = FAULT_BY_ID["angle_channels_disagree"]


def reaction(program: Program, apart_rad: float, *, torque_nm: float = 0.0, speed_rad_s: float = 0.0, age: int = 1):
    """The reaction to a difference that stays, with both torques and both ages alike."""
    watch, measured = Watch(program), Measured()
    measured.drive_apart_rad, measured.speed_rad_s = apart_rad, speed_rad_s
    measured.fastest_rad_s, measured.request_age_scans = abs(speed_rad_s), age
    measured.torque_in_nm = measured.torque_out_nm = torque_nm
    image = READY._replace(drive_age_scans=age, sample_age_scans=age)
    for _ in range(debounce_scans(FAULT, program)):
        assert watch.look(image, measured, S.RAMP_POS) == Reaction.NONE
    return watch.look(image, measured, S.RAMP_POS)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_difference_at_rest_has_its_limit_in_both_directions(side):
    limit_rad = LIMITS.angle_agreement_rad
    assert reaction(short_program(), side * 0.99 * limit_rad) == Reaction.NONE
    assert reaction(short_program(), side * 1.01 * limit_rad) == Reaction.QUICK_STOP


def test_a_coupling_that_twists_is_allowed_its_twist():
    soft = freeze_limits(short_program(), coupling_rad_per_nm=0.5 * ARCMIN)
    twisted_rad = LIMITS.angle_agreement_rad + 4.0 * 0.5 * ARCMIN
    assert reaction(soft, 0.99 * twisted_rad, torque_nm=-4.0) == Reaction.NONE
    assert reaction(soft, 1.01 * twisted_rad, torque_nm=-4.0) == Reaction.QUICK_STOP
    assert reaction(short_program(), 0.99 * twisted_rad, torque_nm=-4.0) == Reaction.QUICK_STOP
    at_output = replace(soft, loading_input=False)
    assert reaction(at_output, 0.99 * twisted_rad, torque_nm=4.0) == Reaction.NONE


def test_values_of_different_age_differ_by_what_the_shaft_has_turned():
    turned_rad = LIMITS.angle_agreement_rad + 0.5 * (4 + 4 + LIMITS.angle_lag_scans) * 1e-3
    assert reaction(short_program(), 0.99 * turned_rad, speed_rad_s=-0.5, age=4) == Reaction.NONE
    assert reaction(short_program(), 0.99 * turned_rad, speed_rad_s=-0.5, age=1) == Reaction.QUICK_STOP


def looked_at(speeds_rad_s: list[float], late_scans: int, *, stuck_from: int | None = None) -> bool:
    """Whether the two disagree for a shaft that turns so, seen by an amplifier that answers so much later.

    It measures when it is asked, and is asked again when it has answered; `stuck_from`: its angle stands from there on.
    """
    program = freeze_limits(short_program(), sample_stale_scans=100, sample_late_scans=100)
    context, watch = Context(program), Watch(program)
    context.take_references(READY)
    angle_rad = shown_rad = measured_rad = 0.0
    asked = age = 0
    disagree = 0
    for scan, speed_rad_s in enumerate(speeds_rad_s):
        age += 1
        if scan - asked >= late_scans:
            shown_rad, age = measured_rad, 0
            if stuck_from is None or scan < stuck_from:
                measured_rad = angle_rad
            asked = scan
        image = READY._replace(
            drive_angle_rad=angle_rad,
            drive_velocity_rad_s=speed_rad_s,
            angle_in_rad=shown_rad,
            sample_age_scans=age,
            sample_counter=scan,
            drive_age_scans=0,
        )
        context.measure(image)
        watch.look(image, context.measured, S.RAMP_POS)
        disagree |= watch.active >> FAULT.number & 1
        angle_rad += speed_rad_s * program.period_s
    return bool(disagree)


TURNING = st.lists(st.tuples(st.floats(-8.0, 8.0), st.integers(1, 60)), min_size=1, max_size=8)
"""Speeds of the loaded shaft [rad/s], each for so many scans."""


@pytest.mark.parametrize("late_scans", [1, 5, 10, 20])
@given(TURNING)
def test_a_slow_amplifier_is_no_disagreement_however_the_shaft_turns(late_scans: int, turning: list[tuple[float, int]]):
    speeds_rad_s = [speed_rad_s for speed_rad_s, scans in [*turning, (0.0, 60)] for _ in range(scans)]
    assert not looked_at(speeds_rad_s, late_scans)


@pytest.mark.parametrize("late_scans", [5, 10, 20])
def test_a_shaft_that_has_just_stopped_is_not_yet_where_a_slow_amplifier_saw_it(late_scans: int):
    assert not looked_at([4.0] * 100 + [0.0] * 100, late_scans)


@pytest.mark.parametrize("late_scans", [1, 5, 10, 20])
def test_an_angle_that_stands_is_seen_behind_a_slow_amplifier_too(late_scans: int):
    assert looked_at([0.5] * 400, late_scans, stuck_from=50)


def test_the_largest_speed_is_kept_for_as_long_as_a_value_may_be_old():
    program = short_program()
    oldest = (
        2 * program.limits.sample_stale_scans + program.limits.drive_stale_scans + math.ceil(LIMITS.angle_lag_scans)
    )
    context = Context(program)
    context.measure(READY._replace(drive_velocity_rad_s=-3.0))
    kept = []
    for _ in range(3 * oldest):
        context.measure(READY)
        kept.append(context.measured.fastest_rad_s)
    assert kept[oldest - 2] == 3.0
    assert kept[2 * oldest + 1] == 0.0
    context.measure(READY._replace(drive_velocity_rad_s=math.nan))
    context.measure(READY)
    assert context.measured.fastest_rad_s == 0.0, "what is no number is told by another fault"


def test_the_drive_may_count_from_anywhere():
    run = Timeline(short_program())
    run.bench.drive_zero_rad = -2.0e5
    run.until_finished()
    assert run.controller.state == S.COMPLETE


@pytest.mark.parametrize("factor", [0.5, -1.0, 1.05])
def test_a_wrong_gear_ratio_is_seen_in_the_first_ramp_to_the_peak(factor):
    run = Timeline(short_program())
    run.bench.drive_gear_error = factor
    run.until_finished()
    assert run.alarms() == ["angle_channels_disagree"]
    assert S.RAMP_POS not in run.states()


def stuck_in_a_ramp() -> Timeline:
    run = Timeline(short_program())
    run.until_state(S.RAMP_NEG)
    run.bench.frozen = {"angle_in_rad": run.bench.image.angle_in_rad}
    run.until_finished()
    assert run.alarms() == ["angle_channels_disagree"]
    return run


def test_a_dead_angle_sensor_does_not_stand_against_the_way_back():
    run = stuck_in_a_ramp()
    run.command(Command.ACKNOWLEDGE)
    run.command(Command.RESET)
    run.until(lambda orders: orders.state == S.STOPPED)
    assert run.states()[-4:] == [S.FAULT, S.UNLOAD, S.RELEASE, S.STOPPED]
    assert run.alarms() == ["angle_channels_disagree"]


def test_a_drive_that_counts_anew_after_a_fault_does_not_stand_against_the_way_back_either():
    run = Timeline(short_program())
    run.until_state(S.RAMP_NEG)
    run.bench.frozen = {"estop_released": 0}
    run.until_finished()
    run.bench.frozen = {}
    run.bench.drive_zero_rad = 7.0
    run.go()
    run.command(Command.ACKNOWLEDGE)
    run.command(Command.RESET)
    run.until(lambda orders: orders.state == S.STOPPED)
    assert run.alarms() == ["estop"]


def test_both_shafts_are_compared_on_the_side_that_is_loaded():
    for loading_input, moved in ((True, "angle_in_rad"), (False, "angle_out_rad")):
        context = Context(replace(short_program(), loading_input=loading_input))
        context.take_references(READY._replace(angle_in_rad=1.0, angle_out_rad=2.0, drive_angle_rad=3.0))
        zero = {"angle_in_rad": 1.0, "angle_out_rad": 2.0}
        image = READY._replace(**{**zero, moved: zero[moved] + 0.5})
        assert math.isclose(context.travel_rad(image), 0.5)
        assert context.drive_angle_zero_rad == 3.0
