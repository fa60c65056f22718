"""Torque by stored lines that are the mean of several units: what another unit may differ by."""

from dataclasses import replace

import numpy as np
import pytest
from reference_unit import FIGURES, ReferenceUnit, bench_trace

from analysis.evaluation.pipeline import analyse
from analysis.loop.method import Method, MetricWanted
from analysis.torque_ratio.quadrant_fit import fit_quadrants
from analysis.torque_ratio.quadrants import QUADRANTS, Quadrants, TorqueLine
from analysis.trace.runs import commanded_runs
from analysis.uncertainty.figures import LineCovariance, UnitDeviation
from analysis.uncertainty.scatter import student_factor
from benchmarks.simulated.coverage import coverage, simulated_pairs
from benchmarks.simulated.simulated_run import SimulatedBench
from recipes import load_bench
from station.bench.figures import figures_of

TRACE = bench_trace(ReferenceUnit(), 453.2)
ALONE = replace(TRACE, torque_out_nm=None)
METHOD = Method(ratio=121, rated_torque_nm=412, output_torque="calibrated")
KNOWN = replace(FIGURES, calibration=dict.fromkeys(QUADRANTS, LineCovariance(0.0, 0.0)))


def moved(mean: Quadrants, by: float) -> Quadrants:
    """Return another unit's ratio: more friction in all quadrants, and a longer transition."""
    lines = []
    for name in QUADRANTS:
        line: TorqueLine = getattr(mean, name)
        more = -by if name in ("load_positive", "unload_negative") else by
        lines.append(TorqueLine(line.offset_nm + more, line.slope * (1.0 + more / 5000.0)))
    length = mean.transition_rad * (1.0 + by / 20.0)
    return Quadrants(lines[0], lines[1], lines[2], lines[3], transition_rad=length)


MEAN = replace(fit_quadrants(TRACE, commanded_runs(TRACE)), fits={}, left={})


def deviation(unit: Quadrants) -> UnitDeviation:
    return UnitDeviation.between(unit, MEAN)


@pytest.mark.parametrize(
    ("name", "within"),
    [("backlash_width_3pct", 0.15), ("stiffness_lsq", 0.05), ("hysteresis_energy", 0.1), ("windup", 0.25)],
)
def test_the_row_is_what_the_units_own_lines_would_change(name: str, within: float) -> None:
    """Two units, as far from their mean to either side: d √2 · √(1 + 1/2) · t(1) / 2.

    In the transition after a turn it is rougher: the loop begins with a mean of samples, and not at the turn itself.
    """
    by = 1.0  # as units differ; smaller changes drown in what monotone regression makes of them
    wanted = [MetricWanted(name)]
    units = [deviation(moved(MEAN, by)), deviation(moved(MEAN, -by))]
    figures = replace(KNOWN, calibrated_units=units)
    result = analyse(ALONE, replace(METHOD, quadrants=MEAN), wanted, figures=figures).metrics[0].headline
    values = [
        analyse(ALONE, replace(METHOD, quadrants=moved(MEAN, way)), wanted).metrics[0].headline.value
        for way in (by, -by)
    ]
    rows = {row.quantity: row.contribution for row in result.budget.rows}
    expected = abs(values[0] - values[1]) / 2.0 * np.sqrt(2.0) * np.sqrt(1.5) * student_factor(1) / 2.0
    assert rows["other_unit"] == pytest.approx(expected, rel=within)


def test_lines_of_the_run_itself_are_not_those_of_another_unit() -> None:
    figures = replace(FIGURES, calibrated_units=[deviation(moved(MEAN, by)) for by in (1.0, -1.0)])
    found = analyse(TRACE, METHOD, [MetricWanted("windup")], figures=figures).metrics[0].headline
    assert "other_unit" not in {row.quantity for row in found.budget.rows}


def test_interval_covers_the_true_value_of_another_unit() -> None:
    """A bounded version of `python -m benchmarks.coverage_study --torque stored`."""
    bench = SimulatedBench(rate_nm_s=480.0, cycles=1)
    method = Method(
        ratio=bench.ratio,
        rated_torque_nm=412.0,
        fixture_stiffness_nm_per_arcmin=bench.fixture_nm_per_arcmin,
        output_torque="calibrated",
    )
    wanted = [MetricWanted("backlash_width_3pct"), MetricWanted("windup"), MetricWanted("stiffness_lsq")]
    figures = figures_of(load_bench("virtual"))
    for row in coverage(wanted, simulated_pairs(10, figures, wanted, method, bench, calibrated_units=4)):
        assert row.covered >= 0.6, row  # with 92 % less than once in a thousand
        assert row.largest_relative > 0.02, row  # and the lines of one run would have said a tenth of it
