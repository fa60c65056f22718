"""One per cent of the samples lost, ten to thirty in a row as a busy machine loses them: what it does to the metrics.

`sampling.missed_periods` of the shipped recipes rests on this. Figures of every metric stand in `docs/decisions.md`.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from reference_unit import FIGURES, RATIO, Bench, ReferenceUnit, bench_trace

from analysis.evaluation.pipeline import Result, analyse
from analysis.loop.method import Method, MetricWanted
from analysis.trace.trace import Trace
from definitions.metrics import METRICS
from recipes import load_recipe, shipped_recipes

LOST = 0.01
IN_A_ROW = (10, 30)
PEAK_NM = 453.2
METHOD = Method(
    ratio=RATIO, rated_torque_nm=412.0, fixture_stiffness_nm_per_arcmin=1e4, catalogue_stiffness_nm_per_arcmin=100.0
)
NOISY = Bench()
QUIET = dataclasses.replace(
    NOISY, torque_out_noise_nm=0.0, torque_in_noise_nm=0.0, angle_in_bits=None, angle_out_bits=None
)
SLOW_NM_S, QUICK_NM_S = 60.0, 120.0
"""Ramps of the shipped recipes."""


def lost_at_random(trace: Trace, seed: int) -> np.ndarray:
    """Mark bursts, wherever they fall, until one per cent of the samples is lost."""
    random, lost = np.random.default_rng(seed), np.zeros(trace.samples, bool)
    while lost.mean() < LOST:
        begin = random.integers(trace.samples)
        lost[begin : begin + random.integers(IN_A_ROW[0], IN_A_ROW[1], endpoint=True)] = True
    return lost


def lost_at(trace: Trace, torque_nm: float) -> np.ndarray:
    """Mark the longest burst at each place where the torque goes through a value, in every cycle."""
    lost, half = np.zeros(trace.samples, bool), IN_A_ROW[1] // 2
    for place in np.flatnonzero(np.diff(np.sign(trace.torque_out_nm - torque_nm))):
        lost[max(place - half, 0) : place + half] = True
    return lost


def judged(trace: Trace) -> Result:
    return analyse(trace, METHOD, [MetricWanted(name) for name in METRICS], figures=FIGURES)


def judged_without(trace: Trace, lost: np.ndarray) -> Result:
    channels = ("t_s", "torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad", "segment")
    return judged(dataclasses.replace(trace, **{name: getattr(trace, name)[~lost] for name in channels}))


def moves(whole: Result, part: Result) -> dict[tuple[str, str], float]:
    """By how much each side of each metric has moved, in expanded uncertainties of its budget."""
    found = {}
    for before, after in zip(whole.metrics, part.metrics, strict=True):
        for was, now in zip(before.sides, after.sides, strict=True):
            assert was.value is not None, was.reason
            assert now.value is not None, now.reason
            name = before.wanted.id, was.side
            # a grade counts in whole steps, and has no uncertainty of its own
            found[name] = (now.value - was.value) / was.uncertainty if was.uncertainty else now.value - was.value
    assert {name for name, _ in found} == set(METRICS)
    return found


@pytest.fixture(scope="module", params=[SLOW_NM_S, QUICK_NM_S], ids=["60 N·m/s", "120 N·m/s"])
def quiet(request) -> tuple[Trace, Result]:
    bench = dataclasses.replace(QUIET, rate_nm_s=request.param)
    trace = bench_trace(ReferenceUnit(), PEAK_NM, bench=bench)
    return trace, judged(trace)


@pytest.mark.parametrize("seed", [0, 1, 2, 19])
def test_no_metric_moves_by_a_fifth_of_its_uncertainty(quiet, seed):
    """Without noise, so that nothing but the loss itself is seen."""
    trace, whole = quiet
    found = moves(whole, judged_without(trace, lost_at_random(trace, seed)))
    assert max(map(abs, found.values())) <= 0.2


@pytest.mark.parametrize("torque_nm", [0.0, 12.36, 412.0])
def test_nor_where_every_cycle_loses_the_place_that_a_metric_is_read_at(quiet, torque_nm):
    trace, whole = quiet
    found = moves(whole, judged_without(trace, lost_at(trace, torque_nm)))
    assert max(map(abs, found.values())) <= 0.2


def test_a_loss_at_every_turn_is_the_worst_and_within_half_of_the_uncertainty(quiet):
    """The last samples before a turn are those that the spring constant ends at."""
    trace, whole = quiet
    found = moves(whole, judged_without(trace, lost_at(trace, PEAK_NM - 0.3)))
    worst = max(found, key=lambda name: abs(found[name]))
    assert worst[0] == "spring_constant"
    assert abs(found.pop(worst)) <= 0.5
    assert max(map(abs, found.values())) <= 0.2


@pytest.mark.parametrize("seed", range(3))
def test_with_noise_it_is_drawn_anew_within_what_the_uncertainty_holds_for_it(seed):
    trace = bench_trace(ReferenceUnit(), PEAK_NM, bench=dataclasses.replace(NOISY, rate_nm_s=QUICK_NM_S), seed=seed)
    found = moves(judged(trace), judged_without(trace, lost_at_random(trace, seed)))
    assert max(map(abs, found.values())) <= 0.5


def test_the_shipped_recipes_allow_no_more_than_was_tried():
    for name in shipped_recipes():
        assert load_recipe(name).sampling.missed_periods_fraction <= LOST
