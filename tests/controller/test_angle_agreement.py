"""Drive and angle sensor of the loaded shaft: what they may differ by, and what stands still, slips or is wrong."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from bench_model import READY, freeze_limits
from programs import ARCMIN, LIMITS, short_program
from timeline import Timeline

from controller.conditions import Measured
from controller.context import Context
from controller.debounce import debounce_scans
from controller.faults import FAULT_BY_ID
from controller.image import Command, Reaction, State
from controller.interlocks import Watch
from controller.program import Program

S = State
FAULT = FAULT_BY_ID["angle_channels_disagree"]


def reaction(program: Program, apart_rad: float, *, torque_nm: float = 0.0, speed_rad_s: float = 0.0, age: int = 1):
    """The reaction to a difference that stays, with both torques and both ages alike."""
    watch, measured = Watch(program), Measured()
    measured.drive_apart_rad, measured.speed_rad_s = apart_rad, speed_rad_s
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
