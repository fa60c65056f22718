"""The torque sweep: continuous in value and rate, whole periods, held and stopped."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from programs import short_program
from timeline import Timeline

from controller.sweep import TorqueSweep, sine
from definitions.image import Command, State
from definitions.program import Program, Segment, Sweep

PERIOD_S = 1e-3
SWEEP = Sweep(amplitude_nm=30.0, from_hz=1.0, to_hz=2.0, period_scans=2000, periods=3)
MEAN_NM = 200.0


def whole(from_hz: float, cycles: int, period_scans: int, amplitude_nm: float) -> Sweep:
    """A sweep of so many cycles in a period, as the compiler makes them."""
    to_hz = 2.0 * cycles / (period_scans * PERIOD_S) - from_hz
    return Sweep(amplitude_nm, from_hz, to_hz, period_scans, 2)


@given(st.floats(-1e6, 1e6))
def test_sine_is_that_of_the_phase(cycles: float) -> None:
    assert sine(cycles) == pytest.approx(math.sin(2.0 * math.pi * (cycles - math.floor(cycles))), abs=5e-6)


@settings(max_examples=30, deadline=None)
@given(st.floats(1.0, 3.0), st.integers(8, 20), st.sampled_from([4000, 4001]), st.floats(1.0, 100.0))
def test_torque_and_rate_are_continuous_and_zero_at_both_ends(
    from_hz: float, cycles: int, period_scans: int, amplitude_nm: float
) -> None:
    sweep = whole(from_hz, cycles, period_scans, amplitude_nm)
    highest_hz = max(sweep.from_hz, sweep.to_hz)
    going = TorqueSweep(PERIOD_S)
    torques, rates = [going.torque_nm], [going.rate_nm_s]
    while not going.is_over(sweep):
        going.advance(sweep, 1)
        torques.append(going.torque_nm)
        rates.append(going.rate_nm_s)
    assert len(torques) == sweep.scans + 1
    assert abs(torques[-1]) < 1e-4 * amplitude_nm
    assert abs(rates[-1]) < 1e-3 * amplitude_nm
    assert max(map(abs, torques)) <= amplitude_nm * (1.0 + 1e-5)
    steepest = 2.0 * math.pi * highest_hz * amplitude_nm
    sharpest = 1.5 * (2.0 * math.pi * highest_hz) ** 2 * amplitude_nm
    for place in range(1, len(torques)):
        moved = torques[place] - torques[place - 1]
        middle = (rates[place] + rates[place - 1]) / 2.0
        assert abs(moved - middle * PERIOD_S) <= 2e-3 * steepest * PERIOD_S + 1e-4 * amplitude_nm
        assert abs(rates[place] - rates[place - 1]) < sharpest * PERIOD_S + 1e-3 * steepest


def test_the_middle_periods_are_alike() -> None:
    sweep = replace(SWEEP, periods=4)
    going = TorqueSweep(PERIOD_S)
    torques = []
    while not going.is_over(sweep):
        going.advance(sweep, 1)
        torques.append(going.torque_nm)
    second, third = torques[2000:4000], torques[4000:6000]
    assert second == pytest.approx(third, abs=1e-9)


def test_missed_periods_keep_the_time_of_the_sweep() -> None:
    one, other = TorqueSweep(PERIOD_S), TorqueSweep(PERIOD_S)
    for _ in range(300):
        one.advance(SWEEP, 1)
    other.advance(SWEEP, 100)
    other.advance(SWEEP, 200)
    assert (one.torque_nm, one.rate_nm_s) == (other.torque_nm, other.rate_nm_s)


def sweeping_program() -> Program:
    """The short program with a sweep instead of its measured cycle."""
    program = short_program()
    first = next(one.index for one in program.segments if one.state == State.RAMP_POS)
    ramp, dwell = program.segments[first : first + 2]
    ramp = replace(ramp, target_nm=MEAN_NM)
    dwell = replace(dwell, start_nm=MEAN_NM, target_nm=MEAN_NM)
    sweep = Segment(
        first + 2, State.REVERSE, "sweep", 0, 0, 1, MEAN_NM, MEAN_NM, 800.0, 0.0, 0.0, 0, 30_000, SWEEP.scans, SWEEP
    )
    unload = replace(program.segments[-1], index=first + 3, start_nm=MEAN_NM)
    segments = (*program.segments[:first], ramp, dwell, sweep, unload)
    return replace(program, segments=segments, unload_segment=first + 3)


@pytest.fixture(scope="module")
def under_way() -> Timeline:
    """A run in the second period of its sweep."""
    run = Timeline(sweeping_program())
    run.until(lambda orders: orders.segment == len(run.controller.program.segments) - 2)
    run.go(SWEEP.period_scans)
    return run


def test_a_run_sweeps_about_the_mean_and_unloads(under_way: Timeline) -> None:
    run = under_way.branch()
    begun = len(run.orders)
    run.until_finished()
    swept = [orders for orders in run.orders if orders.segment == len(run.controller.program.segments) - 2]
    references = [orders.reference_torque_nm for orders in swept]
    assert max(references) == pytest.approx(MEAN_NM + SWEEP.amplitude_nm, abs=0.1)
    assert min(references) == pytest.approx(MEAN_NM - SWEEP.amplitude_nm, abs=0.1)
    assert len(swept) == pytest.approx(SWEEP.scans, abs=2)
    assert {orders.state for orders in swept} == {State.REVERSE}
    torques = [image.torque_out_nm for image in run.images[begun : begun + SWEEP.period_scans]]
    assert max(torques) - min(torques) > SWEEP.amplitude_nm
    assert run.states()[-1] == State.COMPLETE
    slew = run.controller.program.control.slew_nm_s * PERIOD_S
    targets = [orders.drive_target_torque_nm for orders in swept]
    assert max(abs(one - other) for one, other in pairwise(targets)) <= slew * (1.0 + 1e-9)


def test_a_hold_stops_the_time_of_the_sweep(under_way: Timeline) -> None:
    run = under_way.branch()
    late = run.controller.program.limits.sample_late_scans
    run.bench.frozen = {"sample_age_scans": late + 1}
    run.go(4)
    held = {orders.reference_torque_nm for orders in run.orders[-2:]}
    assert len(held) == 1
    run.bench.frozen = {}
    before = len(run.orders)
    run.until_state(State.UNLOAD)
    assert len(run.orders) - before > SWEEP.scans - SWEEP.period_scans - 4


def test_a_stop_in_a_sweep_unloads(under_way: Timeline) -> None:
    run = under_way.branch()
    run.command(Command.STOP)
    run.until_finished()
    assert run.states()[-3:] == [State.UNLOAD, State.RELEASE, State.STOPPED]


def test_the_peak_of_a_program_holds_the_amplitude() -> None:
    program = sweeping_program()
    swept = replace(program, segments=program.segments[-2:])
    assert swept.peak_torque_nm == MEAN_NM + SWEEP.amplitude_nm
