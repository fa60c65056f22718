"""What a bench file declares reaches the uncertainty: runs, and traces from elsewhere with and without a bench."""

import math
from pathlib import Path
from typing import get_args

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pytest
from lostmotion_command import here

from analysis.trace.segment_names import segment_name
from analysis.trace.trace import SegmentInfo
from analysis.uncertainty.distributions import DISTRIBUTIONS, STATED_BY
from analysis.uncertainty.figures import StatedBy
from benchmarks.simulated.simulated_run import SimulatedBench, course_of, measured_trace
from benchmarks.simulated.simulated_unit import SimulatedUnit
from recipes import RecipeError, load_bench, parse_bench, shipped_benches
from recipes.schema.sensor_schema import TorqueSensor
from station.bench.figures import figures_of
from station.cli.runs.evaluate_anew import elsewhere


@pytest.mark.parametrize("name", list(shipped_benches()))
def test_every_shipped_bench_declares_what_a_budget_needs(name: str) -> None:
    bench = load_bench(name)
    found = figures_of(bench, bench.calibrations[0] if bench.calibrations else None)
    assert found.torque_out is not None
    assert found.angle_in is not None
    assert found.torque_out.gain_fraction == bench.sensors.torque_out.accuracy_fraction
    assert found.angle_in.step_rad == 2 * math.pi / 2**bench.sensors.angle_in.resolution_bits
    assert found.lock_width_arcmin == pytest.approx(0.002)
    assert all(line.u_slope > 0 and line.u_offset_nm > 0 for line in found.calibration.values())
    assert len(found.calibration) == (4 if bench.calibrations else 0)


def test_who_states_the_figures_of_a_torque_sensor() -> None:
    """Left out it is the data sheet; the virtual benches have certificates; anything else is refused with its place."""
    text = shipped_benches()["virtual"].read_text(encoding="utf-8")
    plain = text.replace(", stated_by: certificate", "")
    assert plain.count("stated_by: certificate") == text.count("stated_by: certificate") - 2
    for source, by in ((plain, "data_sheet"), (text, "certificate")):
        found = figures_of(parse_bench(source.encode(), "b.yaml"))
        assert (found.torque_in.stated_by, found.torque_out.stated_by) == (by, by)
    with pytest.raises(RecipeError, match=r"torque_in.stated_by: .*hearsay.*certificate"):
        parse_bench(text.replace("stated_by: certificate", "stated_by: hearsay", 1).encode(), "b.yaml")


def test_every_word_of_the_option_has_a_distribution() -> None:
    words = get_args(TorqueSensor.model_fields["stated_by"].annotation)
    assert set(words) == set(get_args(StatedBy)) == set(STATED_BY)
    assert set(STATED_BY.values()) <= set(DISTRIBUTIONS)


def test_trace_from_elsewhere_has_a_budget_only_with_its_bench(tmp_path: Path) -> None:
    bench = SimulatedBench(rate_nm_s=240.0, cycles=2)
    figures = figures_of(load_bench("virtual"))
    trace = measured_trace(course_of(SimulatedUnit(), bench), bench, figures, np.random.default_rng(3))
    channels = ("t_s", "torque_in_nm", "torque_out_nm", "angle_in_rad", "angle_out_rad")
    columns = {name: getattr(trace, name) for name in channels}
    names = {key: segment_name(SegmentInfo(*info)) for key, info in trace.segments.items()}
    columns["segment"] = [names[int(key)] for key in trace.segment]
    file = tmp_path / "trace.csv"
    pa_csv.write_csv(pa.table(columns), file)
    alone = elsewhere(file, "rv-40e-121-quick", None)
    known = elsewhere(file, "rv-40e-121-quick", "virtual", draws=20)
    assert {metric.uncertainty_kind for metric in alone.metrics} == {"repeatability"}
    assert any("repeatability only" in note for note in alone.notes)
    assert {metric.uncertainty_kind for metric in known.metrics} == {"budget"}
    assert all(metric.budget and metric.uncertainty > 0 for metric in known.metrics)
    assert known.metrics[0].monte_carlo.draws == 20
    for metric in known.metrics:
        for side in metric.sides.values():
            assert side.monte_carlo.low < side.value < side.monte_carlo.high
        assert metric.sides[metric.side].monte_carlo == metric.monte_carlo
    assert {side.monte_carlo for metric in alone.metrics for side in metric.sides.values()} == {None}
    asked = ("analyze", str(file), "--recipe", "rv-40e-121-quick", "--monte-carlo", "60")
    shown = here(*asked, "--bench", "virtual").out
    assert "Monte Carlo, 60 draws of all errors at once" in shown
    for name in ("backlash_width_3pct side −", "torque_ratio_offset load side −", "windup"):
        row = next(line for line in shown.splitlines() if line.startswith(f"{name} "))
        assert " … " in row, name
    assert shown.index("Monte Carlo") < shown.index("record  ")
    assert "torque_ratio_slope load side +" in here(*asked).out
    assert "because they have no uncertainty budget: backlash_width_3pct side +" in " ".join(here(*asked).out.split())
    few = here(*asked[:-1], "1")
    assert (few.exit_code, "--monte-carlo: found 1; allowed: 0 (none), or 50 and more" in few.err) == (2, True)
