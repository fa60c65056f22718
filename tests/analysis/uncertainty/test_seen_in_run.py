"""Noise of an angle, slow noise of a torque, and a late locked shaft are in the budget, as the samples show them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from budget_support import METHOD, QUIET, TRACE, UNIT, contributions, metric
from reference_unit import ARC, FIGURES, RATIO, bench_trace
from scipy.signal import lfilter

from analysis.loop.measured import measure
from analysis.trace.trace import Trace
from analysis.uncertainty.seen_in_run import (
    NO_SLOW_NOISE,
    locked_width_arcmin,
    noise_seen_arcmin,
    slow_noise_seen,
    torque_steps_nm,
)

NOISE_ARCMIN = 0.01
LAG_S = 0.25
ONE_CYCLE = bench_trace(UNIT, 453.2, cycles=1)
WANDERS_NM = 1.0
WANDERS_S = 0.1


def noisy(trace: Trace, arcmin: float) -> Trace:
    noise = np.random.default_rng(3).normal(0.0, arcmin * RATIO * ARC, trace.angle_in_rad.size)
    return dataclasses.replace(trace, angle_in_rad=trace.angle_in_rad + noise)


def late(trace: Trace, lag_s: float) -> Trace:
    share = 1.0 - np.exp(-1e-3 / lag_s)
    return dataclasses.replace(trace, angle_out_rad=lfilter([share], [1.0, share - 1.0], trace.angle_out_rad))


def wandering(trace: Trace, seed: int) -> Trace:
    kept = np.exp(-1e-3 / WANDERS_S)
    steps = np.random.default_rng(seed).normal(0.0, WANDERS_NM * np.sqrt(1.0 - kept**2), 2 * trace.samples)
    noise = lfilter([1.0], [1.0, -kept], steps)[trace.samples :]
    return dataclasses.replace(trace, torque_out_nm=trace.torque_out_nm + noise)


def test_a_sound_bench_shows_next_to_nothing() -> None:
    found = measure(TRACE, METHOD)
    assert noise_seen_arcmin(found) < 5e-4  # rounding of both encoders
    assert abs(locked_width_arcmin(found)) < 2e-4
    assert contributions(metric("backlash_width_3pct", FIGURES)).get("locked_width", 0.0) < 1e-6


def test_noise_of_an_angle_is_measured_and_counts() -> None:
    trace = noisy(QUIET, NOISE_ARCMIN)
    assert noise_seen_arcmin(measure(trace, METHOD)) == pytest.approx(NOISE_ARCMIN, rel=0.02)
    quiet, now = (contributions(metric("lost_motion", FIGURES, trace=one))["noise"] for one in (QUIET, trace))
    assert now > 1.5 * quiet


def test_slow_samples_tell_no_noise() -> None:
    slow = dataclasses.replace(QUIET, t_s=QUIET.t_s * 10.0)
    assert noise_seen_arcmin(measure(noisy(slow, NOISE_ARCMIN), METHOD)) == 0.0


@pytest.mark.parametrize("name", ["backlash_width_3pct", "windup", "hysteresis_energy"])
def test_what_a_late_locked_shaft_moves_is_in_its_uncertainty(name: str) -> None:
    # Of the lock's spring: 60 N·m/s over 10 000 N·m/arcmin, late by a quarter of a second on both branches.
    true, found = (metric(name, FIGURES, trace=one).headline for one in (QUIET, late(QUIET, LAG_S)))
    width = 2.0 * LAG_S * 60.0 / METHOD.fixture_stiffness_nm_per_arcmin
    assert locked_width_arcmin(measure(late(QUIET, LAG_S), METHOD)) == pytest.approx(width, rel=0.1)
    assert 0.0 < abs(found.value - true.value) <= found.budget.expanded
    assert found.budget.expanded > true.budget.expanded


def test_slow_noise_of_one_cycle_is_told_by_its_torques() -> None:
    found = slow_noise_seen(measure(wandering(ONE_CYCLE, 1), METHOD))
    assert found.sd_nm == pytest.approx(WANDERS_NM, rel=0.2)
    assert found.along_nm == pytest.approx(2.0 * WANDERS_S * 60.0, rel=0.4)  # neighbours of so long, at 60 N·m/s
    assert slow_noise_seen(measure(ONE_CYCLE, METHOD)).sd_nm < 0.02 * WANDERS_NM


def test_cycles_that_scatter_and_one_torque_alone_tell_no_slow_noise() -> None:
    alone = dataclasses.replace(ONE_CYCLE, torque_in_nm=None)
    assert slow_noise_seen(measure(wandering(TRACE, 1), METHOD)) == NO_SLOW_NOISE
    assert slow_noise_seen(measure(wandering(alone, 1), METHOD)) == NO_SLOW_NOISE


@pytest.mark.parametrize("name", ["spring_constant", "stiffness_lsq", "backlash_width_3pct"])
def test_what_slow_noise_moves_in_one_cycle_is_in_its_uncertainty(name: str) -> None:
    """Taken for independent from sample to sample it moved the spring constant by seven times its U."""
    true = metric(name, FIGURES, trace=ONE_CYCLE).headline
    for seed in range(3):
        found = metric(name, FIGURES, trace=wandering(ONE_CYCLE, seed)).headline
        assert abs(found.value - true.value) <= found.budget.expanded


def stepped(step_nm: float, rounding: np.ufunc = np.trunc, trace: Trace = TRACE) -> Trace:
    return dataclasses.replace(trace, torque_out_nm=rounding(trace.torque_out_nm / step_nm) * step_nm)


@pytest.mark.parametrize("tared_nm", [0.0, 0.137])
@pytest.mark.parametrize("rounding", [np.trunc, np.floor, np.round])
def test_coarse_steps_of_a_torque_are_seen(rounding: np.ufunc, tared_nm: float) -> None:
    trace = stepped(0.5, rounding)
    tared = dataclasses.replace(trace, torque_out_nm=trace.torque_out_nm - tared_nm)
    assert torque_steps_nm(measure(tared, METHOD)) == {"torque_out_nm": pytest.approx(0.5)}


def test_a_torque_that_is_fine_computed_or_held_has_no_coarse_steps() -> None:
    held = TRACE.torque_out_nm[np.arange(TRACE.samples) // 5 * 5]
    even = np.round(QUIET.torque_out_nm / 0.06) * 0.06  # 60 N·m/s in steps of 1 ms: each its own
    assert len(np.unique(np.diff(even[:1000]).round(6))) == 1
    for torque in (TRACE.torque_out_nm, QUIET.torque_out_nm, held, even):
        trace = dataclasses.replace(TRACE, torque_out_nm=torque)
        assert torque_steps_nm(measure(trace, METHOD)) == {}


@pytest.mark.parametrize("step_nm", [0.2, 1.0, 2.0])
def test_what_cut_off_decimals_move_is_in_the_uncertainty(step_nm: float) -> None:
    """Cut off, a torque is smaller on both sides: lost motion read larger, by five times its U at 1 N·m."""
    true, found = (metric("lost_motion", FIGURES, trace=one).headline for one in (TRACE, stepped(step_nm)))
    assert 0.3 * found.uncertainty < found.value - true.value <= found.uncertainty
    assert "torque_out_steps" not in contributions(metric("lost_motion", FIGURES, trace=TRACE))
