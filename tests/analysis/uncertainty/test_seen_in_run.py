"""Noise of an angle and a late angle of the locked shaft are in the budget, as the samples show them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from budget_support import METHOD, QUIET, TRACE, contributions, metric
from reference_unit import ARC, FIGURES, RATIO
from scipy.signal import lfilter

from analysis.loop.measured import measure
from analysis.trace.trace import Trace
from analysis.uncertainty.seen_in_run import locked_width_arcmin, noise_seen_arcmin

NOISE_ARCMIN = 0.01
LAG_S = 0.25


def noisy(trace: Trace, arcmin: float) -> Trace:
    noise = np.random.default_rng(3).normal(0.0, arcmin * RATIO * ARC, trace.angle_in_rad.size)
    return dataclasses.replace(trace, angle_in_rad=trace.angle_in_rad + noise)


def late(trace: Trace, lag_s: float) -> Trace:
    share = 1.0 - np.exp(-1e-3 / lag_s)
    return dataclasses.replace(trace, angle_out_rad=lfilter([share], [1.0, share - 1.0], trace.angle_out_rad))


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
