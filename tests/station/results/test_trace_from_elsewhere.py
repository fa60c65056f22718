"""A trace of another bench: what the bench file must be for a verdict to stand on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.trace.errors import AnalysisError
from recipes import RecipeError, find_bench, find_recipe
from station.cli.measure.check import check
from station.cli.runs.analyze import analyze
from station.cli.runs.evaluate_anew import elsewhere
from station.errors import StationError
from station.reports.content import uncertainty_kind
from station.reports.result_notes import note_lines

TRACE = Path(__file__).parents[2] / "data" / "loop_published_curve.csv"
DECIDES = """metrics:
  - {id: backlash_width_3pct, max: 1 arcmin}
decision:
  rule: """
CURVE = """  curve:
    {id: old, made: 2019-01-01, due: 2020-01-01, angles: both,
     points: [{torque: -500 N·m, deflection: -0.05 arcmin},
              {torque: 500 N·m, deflection: 0.05 arcmin}]}
"""


def recipe(folder: Path, rule: str) -> str:
    """The shipped recipe with one metric and a decision rule."""
    text = find_recipe("rv-40e-121-inverse").read_text("utf-8")
    path = folder / "recipe.yaml"
    path.write_text(text[: text.index("metrics:")] + DECIDES + rule + "\n", encoding="utf-8")
    return str(path)


def bench(folder: Path, added: str) -> str:
    text = find_bench("virtual").read_text("utf-8")
    assert "calibrations:" in text
    path = folder / "bench.yaml"
    path.write_text(text.replace("calibrations:", added + "calibrations:"), encoding="utf-8")
    return str(path)


def two_cycles(path: Path, noise_nm: float) -> Path:
    """The published loop twice, with a time and with noise on its torque."""
    head, *rows = TRACE.read_text("utf-8").splitlines()
    noise = np.random.default_rng(7).normal(0.0, 1.0, 2 * len(rows))
    timed = []
    for number, row in enumerate([*rows, *rows]):
        branch, torque, angle = row.split(",")
        timed.append(f"{0.02 * number:.2f},{branch},{float(torque) + noise_nm * noise[number]:.6f},{angle}")
    path.write_text("\n".join([f"t_s,{head}", *timed]) + "\n", encoding="utf-8")
    return path


def test_a_guard_band_passes_nothing_while_nobody_knows_the_sensors(tmp_path: Path) -> None:
    two = two_cycles(tmp_path / "two.csv", noise_nm=0.2)
    guarded = elsewhere(two, recipe(tmp_path, "guard_band"), None)
    assert guarded.metrics[0].uncertainty_kind == "repeatability"
    assert guarded.verdict == "NOT DECIDABLE"
    assert "without a bench U is only the scatter between cycles" in guarded.reasons[0]
    assert elsewhere(two, recipe(tmp_path, "guard_band"), "virtual").verdict == "PASS"
    assert elsewhere(two, recipe(tmp_path, "simple"), None).verdict == "PASS"


def test_one_cycle_without_a_bench_asks_for_the_bench_and_for_no_second_cycle(tmp_path: Path) -> None:
    found = elsewhere(TRACE, recipe(tmp_path, "guard_band"), None)
    assert found.verdict == "NOT DECIDABLE"
    assert all("(--bench)" in reason and "two cycles" not in reason for reason in found.reasons)


def test_a_cycle_that_is_a_copy_of_another_decides_nothing_where_the_bench_has_noise(tmp_path: Path) -> None:
    copied = two_cycles(tmp_path / "copied.csv", noise_nm=0.0)
    found = elsewhere(copied, recipe(tmp_path, "simple"), "virtual")
    assert found.verdict == "NOT DECIDABLE"
    assert "cycles 1 and 2 are copies" in " ".join(found.reasons)


def test_without_time_delay_and_drift_are_not_in_the_budget_and_a_guard_band_decides_nothing(tmp_path: Path) -> None:
    found = elsewhere(TRACE, recipe(tmp_path, "guard_band"), "virtual")
    assert found.metrics[0].uncertainty_kind == "untimed"
    assert {"skew", "drift"}.isdisjoint(row.quantity for row in found.metrics[0].budget)
    assert found.verdict == "NOT DECIDABLE"
    assert "(column t_s)" in found.reasons[0]
    assert any("without delay and drift" in note for note in found.notes)
    assert "no contribution of delay and drift" in uncertainty_kind(found.metrics)
    assert elsewhere(TRACE, recipe(tmp_path, "simple"), "virtual").verdict == "PASS"


def test_errors_that_leave_no_metric_are_the_reason_and_not_the_number_of_cycles(tmp_path: Path) -> None:
    soft = bench(tmp_path, "").replace("bench.yaml", "soft.yaml")
    text = find_bench("virtual").read_text("utf-8")
    large = "torque_out: {full_scale: 20000 N·m, usable: 110 %, tared_zero: 10 %, reversibility: 10 %,"
    Path(soft).write_text(text.replace("torque_out: {full_scale: 1000 N·m, usable: 110 %,", large), encoding="utf-8")
    trace = tmp_path / "timed.csv"
    head, *rows = TRACE.read_text("utf-8").splitlines()
    trace.write_text("\n".join([f"t_s,{head}", *(f"{0.02 * n:.2f},{row}" for n, row in enumerate(rows))]) + "\n")
    found = elsewhere(trace, recipe(tmp_path, "guard_band"), soft)
    assert found.verdict == "NOT DECIDABLE"
    (reason, *_) = found.reasons
    assert "cycles or more" not in reason
    assert "tared_zero" in reason
    assert "sensor errors" in uncertainty_kind(found.metrics)


@pytest.mark.parametrize("bench_name", [None, "virtual"])
@pytest.mark.parametrize("beside", ["the input torque", "calibrate segments"])
def test_the_angle_of_the_lock_is_no_windup(tmp_path: Path, bench_name: str | None, beside: str) -> None:
    head, *rows = TRACE.read_text("utf-8").splitlines()
    if beside == "the input torque":
        head, rows = f"{head},torque_in_nm", [f"{row},0.5" for row in rows]
    else:
        head = head.replace("branch", "segment")
        rows = [row.replace("forward", "measure +1 1").replace("return", "measure -1 1") for row in rows]
        rows.append(rows[-1].replace("measure -1 1", "calibrate +1 0"))
    trace = tmp_path / "trace.csv"
    trace.write_text("\n".join([head, *rows]) + "\n")
    with pytest.raises(AnalysisError, match=f"found angle_out and {beside}") as caught:
        elsewhere(trace, recipe(tmp_path, "simple"), bench_name)
    assert "expected the angle of the input shaft" in str(caught.value)


def test_a_limit_that_no_unit_can_fail_is_refused(tmp_path: Path) -> None:
    path = Path(recipe(tmp_path, "simple"))
    path.write_text(path.read_text("utf-8").replace("max: 1 arcmin", "min: 0 arcmin"), encoding="utf-8")
    with pytest.raises(RecipeError, match="which no unit fails"):
        elsewhere(TRACE, str(path), None)


def test_an_unusual_limit_is_a_note_of_the_result_and_a_warning_of_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = Path(recipe(tmp_path, "simple"))
    path.write_text(path.read_text("utf-8").replace("max: 1 arcmin", "max: 1 deg"), encoding="utf-8")
    found = elsewhere(TRACE, str(path), None)
    assert any("found 60 arcmin for 'backlash_width_3pct'; usual is" in line for line in note_lines(found))
    assert check(str(path), None, as_json=False) == 0
    assert "WARNING recipe " in " ".join(capsys.readouterr().out.split())  # however long the path, and the lines


def test_a_lag_that_nobody_knows_is_a_note_of_the_result(tmp_path: Path) -> None:
    alone, known = (elsewhere(TRACE, recipe(tmp_path, "simple"), name) for name in (None, "virtual"))
    assert any("the lags of the channels are not known" in line for line in note_lines(alone))
    assert not any("lags of the channels are not known" in line for line in note_lines(known))


def test_what_is_out_of_date_on_the_bench_decides_nothing(tmp_path: Path) -> None:
    found = elsewhere(TRACE, recipe(tmp_path, "simple"), bench(tmp_path, CURVE))
    assert found.verdict == "NOT DECIDABLE"
    assert "blank test 'old' of bench 'virtual', which was due on 2020-01-01" in found.reasons[0]


@pytest.mark.parametrize("name", ["folder.csv", "folder.tdms"])
def test_a_folder_that_is_named_like_a_trace_is_told(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(StationError, match="is a folder; name the file in it"):
        analyze(str(tmp_path / name), "rv-40e-121-inverse", None, tmp_path, as_json=True)


def test_a_bench_that_loads_the_other_shaft_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecipeError, match="drives the output shaft"):
        elsewhere(TRACE, recipe(tmp_path, "simple"), "virtual-output")


def test_a_bench_for_other_models_is_refused(tmp_path: Path) -> None:
    text = (
        Path(bench(tmp_path, ""))
        .read_text("utf-8")
        .replace("loading: input ", "models: [RV-20E-81]\n  loading: input ")
    )
    (tmp_path / "other.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(RecipeError, match="not built for"):
        elsewhere(TRACE, recipe(tmp_path, "simple"), str(tmp_path / "other.yaml"))
