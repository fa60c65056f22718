"""A trace of another bench: what the bench file must be for a verdict to stand on it."""

from __future__ import annotations

from pathlib import Path

import pytest

from recipes import RecipeError, find_bench, find_recipe
from station.command_analyze import elsewhere

TRACE = Path(__file__).parents[1] / "data" / "loop_published_curve.csv"
DECIDES = """metrics:
  - {id: backlash_width_3pct, max: 1 arcmin}
decision:
  rule: """
CURVE = """  curve:
    {id: old, made: 2019-01-01, due: 2020-01-01, angles: both,
     points: [{torque: -500 N·m, deflection: -4 arcmin}, {torque: 500 N·m, deflection: 4 arcmin}]}
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


def test_a_guard_band_passes_nothing_while_nobody_knows_the_sensors(tmp_path: Path) -> None:
    two = tmp_path / "two.csv"
    head, *rows = TRACE.read_text("utf-8").splitlines()
    two.write_text("\n".join([head, *rows, *rows]) + "\n")
    guarded = elsewhere(two, recipe(tmp_path, "guard_band"), None, None)
    assert guarded["metrics"][0]["uncertainty_kind"] == "repeatability"
    assert guarded["verdict"] == "NOT DECIDABLE"
    assert "without a bench U holds the scatter of the cycles alone" in guarded["reasons"][0]
    assert elsewhere(two, recipe(tmp_path, "guard_band"), "virtual", None)["verdict"] == "PASS"
    assert elsewhere(two, recipe(tmp_path, "simple"), None, None)["verdict"] == "PASS"


def test_what_is_out_of_date_on_the_bench_decides_nothing(tmp_path: Path) -> None:
    found = elsewhere(TRACE, recipe(tmp_path, "simple"), bench(tmp_path, CURVE), None)
    assert found["verdict"] == "NOT DECIDABLE"
    assert "blank test 'old' of bench 'virtual', which was due on 2020-01-01" in found["reasons"][0]


def test_a_bench_that_loads_the_other_shaft_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecipeError, match="drives the output shaft"):
        elsewhere(TRACE, recipe(tmp_path, "simple"), "virtual-output", None)


def test_a_bench_for_other_models_is_refused(tmp_path: Path) -> None:
    text = (
        Path(bench(tmp_path, ""))
        .read_text("utf-8")
        .replace("loading: input ", "models: [RV-20E-81]\n  loading: input ")
    )
    (tmp_path / "other.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(RecipeError, match="not built for"):
        elsewhere(TRACE, recipe(tmp_path, "simple"), str(tmp_path / "other.yaml"), None)
