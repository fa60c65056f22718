"""A unit that runs through its play on a ramp by torque strikes and bounces: that is no part of its loading line."""

from __future__ import annotations

import pytest
from virtual_benches import Runs, runs_by

from analysis.evaluation.pipeline import analyse
from analysis.loop.method import MetricWanted
from recipes import find_recipe
from station.bench.figures import figures_of
from station.results.evaluation import method_of
from virtual_bench.physics.units import UNITS

RECIPE, UNIT = "static-50nm", "S50"
FEWER = {"\n  period: 1 ms\n": "\n  period: 4 ms\n", "count: 3,": "count: 1,"}
SEEDS = (1, 2, 3, 4)
WANTED = [MetricWanted("torque_ratio_offset"), MetricWanted("torque_ratio_slope")]


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """Runs of the shipped recipe with one cycle and a quarter of the scans, each with sensors of its own."""
    return runs_by(find_recipe(RECIPE), FEWER, dict.fromkeys(SEEDS, UNIT), tmp_path_factory.mktemp("bounced"))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_offset_of_a_unit_that_bounces_is_its_friction(calibrated: Runs, seed: int) -> None:
    """Fitted from 5 % of the peak on, it read −0.33 ± 0.29 N·m: 4.7 U off, as the slope was by 3.8."""
    job, runs = calibrated
    unit = UNITS[UNIT]
    friction_nm = -unit.friction_loading_nm * unit.ratio / (1.0 + unit.friction_loading_fraction)
    result = analyse(runs[seed], method_of(job.recipe, job.bench), WANTED, figures=figures_of(job.bench))
    offset, slope = result.metrics
    for side in offset.sides:
        assert side.value is not None
        assert side.uncertainty is not None
        assert abs(side.value - friction_nm) <= side.uncertainty < 0.15, side.side
    for side in slope.sides:
        assert side.value == pytest.approx(unit.ratio / (1.0 + unit.friction_loading_fraction), rel=5e-3), side.side
    (efficiency,) = [one for one in result.checks if one.id == "efficiency_low"]
    assert efficiency.figure is not None, efficiency.text
    shown = min(side.value for side in slope.sides if side.value is not None)
    assert efficiency.figure == pytest.approx(100.0 * shown / unit.ratio, rel=1e-9)
    assert result.quadrants is not None
    told = " ".join(stage.text for stage in result.stages)
    for name, sign in (("load_positive", ""), ("load_negative", "-")):
        assert f"from {sign}{result.quadrants.begins_nm[name]:.3g} N·m, where" in told
    assert set(result.quadrants.begins_nm) == {"load_positive", "load_negative"}
