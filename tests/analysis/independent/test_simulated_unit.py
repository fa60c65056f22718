"""Laws of the simulated unit of the studies: its loop closes, the first loading meets it, its sides differ as told."""

import dataclasses

import numpy as np
import pytest

from analysis.evaluation.pipeline import analyse
from analysis.loop.method import Method, MetricWanted
from benchmarks.simulated.simulated_run import SimulatedBench, course_of, exact_trace
from benchmarks.simulated.simulated_unit import SIDES, SimulatedUnit

PEAK_NM = 453.2
TORQUE = np.linspace(-PEAK_NM, PEAK_NM, 4001)
UNITS = [SimulatedUnit(), *(SimulatedUnit().varied(np.random.default_rng(seed)) for seed in range(8))]


@pytest.mark.parametrize("unit", UNITS)
def test_loop_closes_and_the_first_loading_arrives_at_it(unit: SimulatedUnit) -> None:
    windup, rising, falling = unit.loop(PEAK_NM)
    assert np.all(np.diff(windup) > 0)
    assert rising[[0, -1]] == pytest.approx([-PEAK_NM, PEAK_NM], abs=1e-3)
    assert falling[[0, -1]] == pytest.approx([-PEAK_NM, PEAK_NM], abs=1e-3)
    assert np.all(rising >= falling - 1e-9)
    virgin_windup, virgin = unit.virgin(PEAK_NM)
    assert (virgin_windup[0], virgin[0]) == (0.0, 0.0)
    assert virgin_windup[-1] == pytest.approx(windup[-1])
    assert virgin[-1] == pytest.approx(PEAK_NM, abs=1e-3)


@pytest.mark.parametrize("difference", [-0.05, 0.0, 0.03])
def test_sides_differ_as_told_and_nothing_jumps(difference: float) -> None:
    unit = SimulatedUnit(side_difference=difference)
    windup = unit.elastic_arcmin(TORQUE)
    positive, negative = windup[-1], -windup[0]
    assert (negative - positive) / ((negative + positive) / 2.0) == pytest.approx(difference)
    assert np.all(np.diff(windup) > 0)
    assert np.abs(unit.elastic_arcmin(np.array([-1e-9, 0.0, 1e-9]))).max() < 1e-9
    turned = dataclasses.replace(unit, side_difference=-difference)
    assert turned.elastic_arcmin(-TORQUE) == pytest.approx(-windup)


def test_a_lot_of_units_differs_on_both_sides_within_what_is_stated() -> None:
    found = [SimulatedUnit().varied(np.random.default_rng(seed)).side_difference for seed in range(200)]
    assert -SIDES <= min(found) < -0.9 * SIDES
    assert 0.9 * SIDES < max(found) <= SIDES


def test_asymmetry_is_half_of_what_the_sides_wind_up_differently() -> None:
    """Of the mean curve, from its place at zero torque: there the elastic torque is what hysteresis holds."""
    bench = SimulatedBench()
    unit = SimulatedUnit(side_difference=0.04)
    wanted = [MetricWanted("asymmetry_at_rated")]
    found = analyse(exact_trace(course_of(unit, bench), bench), Method(bench.ratio, 412.0), wanted).metrics[0]
    rated, zero = SimulatedUnit().elastic_arcmin(np.array([412.0, unit.hysteresis_nm]))
    assert found.headline.value == pytest.approx(0.04 / 2.0 * (rated - zero) * 60.0, rel=0.01)
