"""`metrics`, `analyze --preset` and `repeatability`: the definition stands beside every number."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from analysis import METRICS
from recipes import PRESETS
from recipes.recipe_schema import preset_metrics
from station.command_analyze import analyze
from station.command_metrics import metrics
from station.command_repeatability import repeat
from station.errors import StationError

ROOT = Path(__file__).parents[2]
TRACE = str(ROOT / "tests/data/loop_published_curve.csv")
RECIPE = "rv-40e-121-inverse"
NO_RUNS = Path("no-runs")
Print = Callable[..., str]


@pytest.fixture
def printed(capsys: pytest.CaptureFixture[str]) -> Print:
    """What a command prints, which ends with an exit code."""

    def run(command: Callable[..., int], *args: object, code: int = 0, **options: object) -> str:
        assert command(*args, **options) == code
        return capsys.readouterr().out

    return run


def words(text: str) -> str:
    """A text without its line ends, however wide the screen is."""
    return " ".join(text.split())


def test_list_of_all_metrics_and_presets(printed: Print) -> None:
    found = json.loads(printed(metrics, None, as_json=True))
    assert [metric["id"] for metric in found["metrics"]] == list(METRICS)
    assert [preset["name"] for preset in found["presets"]] == list(PRESETS)
    shown = words(printed(metrics, None, as_json=False))
    for row in METRICS.values():
        assert words(row.text) in shown


def test_one_preset(printed: Print) -> None:
    found = json.loads(printed(metrics, "harmonic", as_json=True))
    assert [metric["id"] for metric in found["metrics"]] == ["k1", "k2", "k3", "lost_motion", "backlash_width_zero"]
    assert found["presets"][0]["metrics"][3] == "lost_motion band 4 %"


@pytest.mark.parametrize(
    "command",
    [
        lambda: metrics("nabtesko", as_json=False),
        lambda: analyze(TRACE, RECIPE, None, NO_RUNS, as_json=True, preset="nabtesko"),
        lambda: repeat([TRACE], RECIPE, "nabtesko", NO_RUNS, as_json=False),
    ],
)
def test_an_unknown_preset_is_named(command: Callable[[], int]) -> None:
    with pytest.raises(StationError, match=r"--preset: found 'nabtesko'.* Did you mean 'nabtesco'\?"):
        command()


def test_each_number_of_a_preset_has_its_definition(printed: Print) -> None:
    asked = (analyze, TRACE, RECIPE, None, NO_RUNS)
    found = json.loads(printed(*asked, code=3, preset="inverse", as_json=True))
    assert found["preset"] == "inverse"
    assert [metric["id"] for metric in found["metrics"]] == [metric.id for metric in preset_metrics("inverse")]
    shown = words(printed(*asked, code=3, preset="inverse", as_json=False))
    for metric in found["metrics"]:
        assert metric["value"] is not None
        assert words(metric["definition"]) in shown
        assert words(metric["estimator"]) in shown


def test_a_preset_without_limits_decides_nothing(printed: Print) -> None:
    found = json.loads(printed(analyze, TRACE, RECIPE, None, NO_RUNS, code=3, preset="harmonic", as_json=True))
    assert found["verdict"] == "NOT DECIDABLE"
    assert "no metric has a limit: there is nothing to decide" in found["reasons"]


def test_a_preset_that_leaves_a_limit_out_passes_nothing(printed: Print) -> None:
    """The one limit that it judges is kept; the others of the recipe are named."""
    found = json.loads(printed(analyze, TRACE, RECIPE, None, NO_RUNS, code=3, preset="inverse", as_json=True))
    assert {metric["verdict"] for metric in found["metrics"]} == {"PASS", None}
    assert found["verdict"] == "NOT DECIDABLE"
    assert found["reasons"][0] == (
        "preset inverse leaves out what the recipe has limits for: lost_motion, spring_constant, stiffness_50_100, "
        "torque_ratio_offset"
    )


def test_a_limit_of_the_recipe_fails_by_a_preset_too(printed: Print) -> None:
    found = json.loads(printed(analyze, TRACE, RECIPE, None, NO_RUNS, code=1, preset="measurement", as_json=True))
    assert found["verdict"] == "FAIL"
    assert "spring_constant, side -: 45.74 N·m/arcmin is below the limit of 108 N·m/arcmin" in found["reasons"][0]


@pytest.fixture
def repeats(tmp_path: Path) -> list[str]:
    """The published loop, and the same with every wind-up two percent larger."""
    head, *rows = Path(TRACE).read_text(encoding="utf-8").splitlines()
    place = next(number for number, name in enumerate(head.split(",")) if "angle" in name)
    changed = [row.split(",") for row in rows]
    for row in changed:
        row[place] = repr(1.02 * float(row[place]))
    other = tmp_path / "second.csv"
    other.write_text("\n".join([head, *map(",".join, changed)]) + "\n", encoding="utf-8")
    return [TRACE, str(other)]


def test_repeatability_over_runs(repeats: list[str], printed: Print) -> None:
    found: Any = json.loads(printed(repeat, repeats, RECIPE, "nabtesco", NO_RUNS, as_json=True))
    assert found["runs"] == repeats
    by_name = {(metric["id"], metric["side"]): metric for metric in found["metrics"]}
    backlash = by_name["backlash_width_zero", "both"]["repeatability"]
    assert backlash["run_values"] == [pytest.approx(0.9408, abs=5e-5), pytest.approx(0.9596, abs=5e-5)]
    assert backlash["sd_runs"] == pytest.approx(0.02 * 0.9408 / 2**0.5, abs=5e-5)
    assert backlash["sd_cycles"] is None
    assert set(by_name) == {("backlash_width_zero", "both"), ("lost_motion", "both"),
                            ("stiffness_50_100", "+"), ("stiffness_50_100", "-")}  # fmt: skip
    shown = printed(repeat, repeats, RECIPE, "nabtesco", NO_RUNS, as_json=False)
    assert words(METRICS["lost_motion"].text) in words(shown)


def test_one_run_is_no_repeat(repeats: list[str]) -> None:
    with pytest.raises(StationError, match="needed are 2 or more of one unit"):
        repeat([repeats[0], repeats[0]], RECIPE, None, NO_RUNS, as_json=True)
    with pytest.raises(StationError, match="--recipe is missing"):
        repeat(repeats, None, None, NO_RUNS, as_json=True)
