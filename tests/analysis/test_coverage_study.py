"""The stated uncertainty holds for simulated units: a bounded version of `make coverage-study`."""

import numpy as np
import pytest
from scipy import stats

from analysis import Method, MetricWanted
from analysis.studies.coverage import CoverageRow, coverage
from analysis.studies.simulated_run import SimulatedBench
from recipes import load_bench
from station.figures import figures_of

UNITS = 24
NAMES = ["backlash_width_3pct", "lost_motion", "stiffness_lsq", "stiffness_50_100", "spring_constant", "windup"]
WANTED = [MetricWanted(name) for name in NAMES]
LEAST = float(stats.binom.ppf(1e-4, UNITS, 0.92)) / UNITS
"""Share covered that a metric with 92 % falls below once in ten thousand such studies; sides of a unit go together."""

FACTOR = float(np.sqrt(stats.chi2.ppf(1 - 1e-4, UNITS - 1) / (UNITS - 1)))
"""How far the standard deviation of so many errors may exceed their u by chance."""


@pytest.fixture(scope="module", params=["reaction", "calibrated"])
def rows(request: pytest.FixtureRequest) -> list[CoverageRow]:
    bench = SimulatedBench(rate_nm_s=120.0, cycles=2)
    method = Method(
        ratio=bench.ratio,
        rated_torque_nm=412.0,
        fixture_stiffness_nm_per_arcmin=bench.fixture_nm_per_arcmin,
        output_torque=request.param,
    )
    return coverage(UNITS, figures_of(load_bench("virtual")), WANTED, method, bench=bench)


def test_interval_covers_the_true_value(rows: list[CoverageRow]) -> None:
    for row in rows:
        assert row.covered >= LEAST, row
        assert 2 * row.deviation <= FACTOR * row.largest, row


def test_uncertainty_is_not_exaggerated(rows: list[CoverageRow]) -> None:
    for row in rows:
        assert 2 * row.deviation * FACTOR >= 0.6 * row.expanded, row


def test_bias_is_small_beside_the_uncertainty(rows: list[CoverageRow]) -> None:
    """A fifth of U, and what chance adds to the mean of so many."""
    for row in rows:
        assert abs(row.bias) < row.expanded * (0.2 + 4 * 0.5 / np.sqrt(UNITS)), row


def test_uncertainty_is_as_small_as_it_has_to_be(rows: list[CoverageRow]) -> None:
    for row in rows:
        if row.metric == "backlash_width_3pct":
            assert row.largest <= 0.02
        elif row.unit == "N·m/arcmin":
            assert row.largest_relative <= 0.005, row
