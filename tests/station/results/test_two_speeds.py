"""`alignment: two_speeds` of a recipe: a delay that nobody declared is found by cycles at two speeds, and taken out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv as pa_csv

from analysis.trace.errors import AnalysisError
from analysis.trace.segment_names import segment_name
from analysis.trace.trace import SegmentInfo, Trace
from benchmarks.simulated.simulated_run import SimulatedBench, course_of
from benchmarks.simulated.simulated_unit import SimulatedUnit
from recipes import check, find_recipe, load_bench, parse_recipe
from recipes.schema.recipe_schema import Measurement
from station.cli.runs.evaluate_anew import elsewhere
from station.documents.result import Evaluation, StageRow
from station.results.evaluation import ALIGNMENTS

LAG_S = 0.05
NOISE_NM = 0.2
TRUE_ARCMIN = 0.94
"""Width of the simulated unit's loop at ±3 %."""
RESTS = 300
"""Samples of rest at the end of a block."""
SHIPPED = find_recipe("rv-40e-121-inverse").read_text("utf-8")
BLOCK = next(line for line in SHIPPED.splitlines(keepends=True) if "torque_cycles" in line)


def recipe_text(alignment: str, *blocks: str) -> str:
    """The shipped recipe with an alignment and other blocks of cycles."""
    text = SHIPPED.replace("  output_torque: reaction", f"  output_torque: reaction\n  alignment: {alignment}", 1)
    assert f"alignment: {alignment}" in text
    return text.replace(BLOCK, "".join(f"  - {block}\n" for block in blocks)) if blocks else text


def recipe(folder: Path, alignment: str) -> str:
    path = folder / f"{alignment}.yaml"
    path.write_text(recipe_text(alignment), encoding="utf-8")
    return str(path)


def late_trace(folder: Path, rates_nm_s: tuple[float, ...], lag_s: float) -> Path:
    """Two cycles of the simulated unit at each rate, one after the other, the torque later than the angles."""
    parts: list[Trace] = []
    for rate in rates_nm_s:
        bench = SimulatedBench(rate_nm_s=rate, cycles=2, fixture_nm_per_arcmin=1e9)
        course = course_of(SimulatedUnit(), bench)
        kept = course.segment > max(key for key, info in course.segments.items() if info.role == "calibrate")
        angle = course.windup_arcmin[kept] * (bench.ratio * np.pi / 10800.0)
        torque, segment = course.torque_nm[kept], course.segment[kept]
        rest = max(course.segments) + 1
        torque, angle = (np.append(values, np.full(RESTS, values[-1])) for values in (torque, angle))
        segments = course.segments | {rest: SegmentInfo("dwell")}
        segment = np.append(segment, np.full(RESTS, rest))
        parts.append(Trace(torque_out_nm=torque, angle_in_rad=angle, angle_out_rad=0.0 * angle, segment=segment,
                           segments=segments))  # fmt: skip
    names = []
    for number, part in enumerate(parts):
        own = {key: info._replace(cycle=info.cycle + 2 * number) for key, info in part.segments.items()}
        names += [segment_name(SegmentInfo(*own[key])) for key in part.segment]
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("torque_out_nm", "angle_in_rad", "angle_out_rad")
    }
    time = np.arange(len(names)) * 1e-3
    noise = np.random.default_rng(5).normal(0.0, NOISE_NM, time.size)
    columns["torque_out_nm"] = np.interp(time - lag_s, time, columns["torque_out_nm"]) + noise
    path = folder / "late.csv"
    pa_csv.write_csv(pa.table({"t_s": time, **columns, "segment": names}), path)
    return path


def read(result: Evaluation) -> tuple[float, StageRow]:
    (aligned,) = [stage for stage in result.stages if stage.stage == "time alignment"]
    return result.metrics[0].value, aligned


def test_a_lag_is_found_and_taken_out_when_the_recipe_says_so(tmp_path: Path) -> None:
    even = elsewhere(late_trace(tmp_path, (60.0, 240.0), 0.0), recipe(tmp_path, "declared"), "virtual")
    late = late_trace(tmp_path, (60.0, 240.0), LAG_S)
    declared = elsewhere(late, recipe(tmp_path, "declared"), "virtual")
    found = elsewhere(late, recipe(tmp_path, "two_speeds"), "virtual")
    assert read(even)[0] - read(declared)[0] > 0.05
    assert read(found)[0] == pytest.approx(read(even)[0], abs=5e-3)
    stage = read(found)[1]
    assert stage.applied
    assert "skew estimated from speeds" in stage.text
    assert stage.figures["angle behind torque"].value == pytest.approx(-LAG_S, rel=0.05)
    quantities = {row.quantity for row in found.metrics[0].budget}
    assert "skew_estimate" in quantities
    assert "skew_estimate" not in {row.quantity for row in declared.metrics[0].budget}


@pytest.mark.parametrize(("lag_s", "rates"), [(-0.05, (60.0, 240.0)), (0.3, (60.0, 240.0)), (0.005, (60.0, 75.0))])
def test_what_is_left_of_any_lag_is_within_u(tmp_path: Path, lag_s: float, rates: tuple[float, float]) -> None:
    """An angle that is late, a long delay, and speeds so near that noise decides when the estimate settles."""
    found = elsewhere(late_trace(tmp_path, rates, lag_s), recipe(tmp_path, "two_speeds"), "virtual")
    metric, stage = found.metrics[0], read(found)[1]
    assert stage.figures["angle behind torque"].value == pytest.approx(-lag_s, rel=0.02, abs=3e-3)
    assert metric.value == pytest.approx(TRUE_ARCMIN, abs=metric.uncertainty)


def test_samples_that_are_moved_by_half_a_period_keep_the_noise_that_was_recorded(tmp_path: Path) -> None:
    late = late_trace(tmp_path, (60.0, 240.0), 0.0505)
    figures = []
    for alignment in ("report", "two_speeds"):
        gates = elsewhere(late, recipe(tmp_path, alignment), "virtual").gates
        figures.append([gate.figure for gate in gates if gate.id in ("noise_low", "noise_high")])
    assert figures[1] == pytest.approx(figures[0])


def test_a_trace_of_one_speed_says_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(AnalysisError, match="expected two speeds that differ"):
        elsewhere(late_trace(tmp_path, (120.0,), LAG_S), recipe(tmp_path, "two_speeds"), "virtual")


SLOW = "torque_cycles: {count: 2, peak_torque: 110 %, torque_rate: 50 N·m/s}"
FAST = "torque_cycles: {count: 1, peak_torque: 110 %, torque_rate: 60 N·m/s}"
LOWER = "torque_cycles: {count: 1, peak_torque: 105 %, torque_rate: 60 N·m/s}"
NEAR = "torque_cycles: {count: 1, peak_torque: 110 %, torque_rate: 59 N·m/s}"
SPEED = "speed_cycles: {count: 1, peak_torque: 110 %, speed: 0.5 rpm, acceleration: 0.5 rad/s^2, time_limit: 300 s}"
STEPS = "step_cycles: {count: 1, peak_torque: 110 %, steps: 10, torque_rate: 20 N·m/s}"


@pytest.mark.parametrize(
    ("alignment", "blocks", "said"),
    [
        ("two_speeds", (SLOW, FAST), ""),
        ("two_speeds", (SLOW, SPEED), ""),
        ("declared", (SLOW,), ""),
        ("report", (SLOW,), ""),
        ("two_speeds", (SLOW,), "alignment: found 'two_speeds', but cycles at 0.5 arcmin/s of wind-up alone"),
        ("two_speeds", (SLOW, STEPS), "sequence at two speeds that differ by 1.2 times or more. Lags are"),
        ("two_speeds", (SLOW, NEAR), "but cycles at 0.5 and 0.59 arcmin/s of wind-up alone"),
        ("two_speeds", (STEPS,), "but no torque_cycles or speed_cycles"),
        ("two_speeds", (FAST, SLOW.replace("count: 2", "count: 1")), "found 'two_speeds' with 2 cycles; allowed: 3"),
        ("two_speeds", (SLOW, LOWER), "torque_cycles.peak_torque: found 432.6 N·m and 453.2 N·m with 'alignment"),
    ],
)
def test_the_sequence_must_have_two_speeds(alignment: str, blocks: tuple[str, ...], said: str) -> None:
    problems = check(parse_recipe(recipe_text(alignment, *blocks).encode(), "r.yaml"), load_bench("virtual"))
    messages = [str(one) for one in problems if "two_speeds" in str(one)]
    assert [said in message for message in messages] == ([True] if said else [])
    if said and "peak" not in said:
        assert "r.yaml:" in messages[0]
        assert " measurement.alignment: " in messages[0]


def test_recipe_and_analysis_mean_the_same() -> None:
    assert set(ALIGNMENTS) == set(Measurement.model_fields["alignment"].annotation.__args__)
