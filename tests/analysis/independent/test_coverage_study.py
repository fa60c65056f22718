"""The stated uncertainty holds for simulated units: a bounded version of `make coverage-study`."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from analysis.loop.method import Method, MetricWanted
from analysis.uncertainty.figures import AngleFigures, SensorFigures, TorqueFigures
from benchmarks.simulated import truth as of_units
from benchmarks.simulated.coverage import CoverageRow, coverage, simulated_pairs
from benchmarks.simulated.kinds import KINDS
from benchmarks.simulated.simulated_run import SimulatedBench
from definitions.metrics import FIT_POINTS, LSQ_POINTS
from recipes import load_bench
from station.bench.figures import figures_of

UNITS = 16
NAMES = [
    "backlash_width_3pct",
    "backlash_width_zero",
    "lost_motion",
    "stiffness_lsq",
    "stiffness_50_100",
    "spring_constant",
    "windup",
    "asymmetry_at_rated",
]
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
    return coverage(WANTED, simulated_pairs(UNITS, figures_of(load_bench("virtual")), WANTED, method, bench))


def test_interval_covers_the_true_value(rows: list[CoverageRow]) -> None:
    for row in rows:
        assert row.covered >= LEAST, row
        assert 2 * row.deviation <= FACTOR * row.largest, row


@pytest.mark.parametrize(("covered", "units", "between"), [(0.5, 10, (0.187, 0.813)), (1.0, 200, (0.982, 1.0))])
def test_interval_of_a_share(covered: float, units: int, between: tuple[float, float]) -> None:
    """Clopper and Pearson; of 10, Documenta Geigy; of all, 0.025^(1/n)."""
    row = CoverageRow("m", "1", 1.0, 0.0, 1.0, 1.0, 1.0, 1.0, covered, 2 * units, units)
    assert row.covered_between == pytest.approx(between, abs=1e-3)


def test_one_error_alone_has_the_deviation_that_its_source_states() -> None:
    """Gain of the sensor alone in a wind-up: ± 2 u is all of what a data sheet allows, and 95 % of a certificate's."""
    bench, units, alone = SimulatedBench(rate_nm_s=480.0, cycles=1), 40, [MetricWanted("windup")]
    method = Method(ratio=bench.ratio, rated_torque_nm=412.0, fixture_stiffness_nm_per_arcmin=1e4)
    quiet = {"zero_fraction": 0.0, "reversibility_fraction": 0.0, "noise_fraction": 0.0, "gain_fraction": 0.02}
    for by, least in (("data_sheet", 1.0), ("certificate", 0.82)):
        sensor = TorqueFigures(1000.0, **quiet, stated_by=by)
        encoder = AngleFigures(1e-9, accuracy_rad=0.0, interpolation_rad=0.0)
        figures = SensorFigures(replace(sensor, full_scale_nm=5.0), sensor, encoder, encoder)
        (row,) = coverage(alone, simulated_pairs(units, figures, alone, method, bench))
        assert row.covered >= least, by
        assert 2 * row.deviation / row.expanded == pytest.approx(1.0, abs=0.35), by


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


def test_the_truth_of_a_fit_counts_as_many_torques_as_its_definition() -> None:
    assert (of_units.FIT_POINTS, of_units.LSQ_POINTS) == (FIT_POINTS, LSQ_POINTS)
    unit = KINDS["RV-40E"]
    peak = 1.1 * unit.rated_nm
    torque = np.linspace(0.2, 0.8, LSQ_POINTS) * unit.rated_nm
    slope = np.polyfit(torque, unit.angle(torque, 1, peak), 1)[0]
    assert of_units.truth(unit, "stiffness_lsq", 1, peak) == pytest.approx(1.0 / slope, rel=1e-9)
