"""How long a condition must hold: the same time in every recipe, neither forgotten too soon nor held against a unit."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from bench_model import READY
from programs import short_program
from ramp_support import SHOWN, S, mid_ramp

from controller.conditions import Measured
from controller.debounce import debounce_scans
from controller.interlocks import INTERLOCKS, Watch
from definitions.faults import FAULT_BY_ID, FAULTS
from definitions.image import (
    Command,
    Reaction,
)


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
    timed = {fault.id for fault in FAULTS if fault.time}
    assert {fault.id for fault in FAULTS if fault.debounce_scans}.isdisjoint(timed)
    assert timed <= {row.fault for row in INTERLOCKS}


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
