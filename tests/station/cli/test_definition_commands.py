"""`metrics`, `analyze --preset` and `repeatability`: the definition stands beside every number."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from lostmotion_command import here
from printed_numbers import reads
from shipped_copies import simple_acceptance

from analysis.evaluation.pipeline import analyse
from analysis.loop.method import Method, MetricWanted
from analysis.trace.trace_files import read_trace
from definitions.metrics import METRICS
from recipes import OWN, PRESETS, Selection, find_recipe, load_bench, parse_recipe
from recipes.schema.metric_schema import preset_metrics
from station.cli.line.repeatability import repeat
from station.cli.runs.analyze import analyze
from station.cli.runs.evaluate_anew import elsewhere
from station.cli.runs.metrics import metrics
from station.errors import StationError
from station.reports.figures.stiffness_plot import stiffness_figure
from station.results.evaluation import method_of, method_of_recipe, wanted_of
from station.results.judged import judged_in

ROOT = Path(__file__).parents[3]
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
        lambda: analyze(TRACE, RECIPE, None, NO_RUNS, as_json=True, selection=Selection("nabtesko")),
        lambda: repeat([TRACE], RECIPE, Selection("nabtesko"), NO_RUNS, as_json=False),
    ],
)
def test_an_unknown_preset_is_named(command: Callable[[], int]) -> None:
    with pytest.raises(StationError, match=r"--preset: found 'nabtesko'.* Did you mean 'nabtesco'\?"):
        command()


def test_each_number_of_a_preset_has_its_definition(printed: Print) -> None:
    asked = (analyze, TRACE, RECIPE, None, NO_RUNS)
    found = json.loads(printed(*asked, code=3, selection=Selection("inverse"), as_json=True))
    assert found["preset"] == "inverse"
    assert [metric["id"] for metric in found["metrics"]] == [metric.id for metric in preset_metrics("inverse")]
    shown = words(printed(*asked, code=3, selection=Selection("inverse"), as_json=False))
    for metric in found["metrics"]:
        assert metric["value"] is not None
        assert words(metric["definition"]) in shown
        assert words(metric["estimator"]) in shown


def test_choices_of_a_recipe_reach_the_analysis() -> None:
    text = find_recipe(RECIPE).read_text(encoding="utf-8")
    breaks = "  break_torque: 80 N·m\n  break_torque_t1: 60 N·m\n  break_torque_t2: 240 N·m\n  calibration: measured "
    asked = (
        "presets: [inverse]\nmetrics:\n  - {id: spring_constant, variant: centred, branch: load, fit: three_region}\n"
    )
    text = text.replace("  calibration: measured ", breaks).replace("metrics:\n", asked)
    recipe = parse_recipe(text.encode(), "r.yaml")
    wanted = wanted_of(recipe)
    assert (wanted[0].variant, wanted[0].branch, wanted[0].fit) == ("centred", "load", "three_region")
    assert [one.fit for one in wanted if one.id == "stiffness_at"] == [None, "six_segment_20pct", "three_region"]
    assert [one.fit for one in wanted_of(recipe, Selection("inverse")) if one.id == "windup"] == ["three_region"]
    method = method_of(recipe, load_bench("virtual"))
    assert (method.break_nm, method.stiffness_breaks_nm) == (80.0, (60.0, 240.0))
    assert method_of_recipe(recipe).stiffness_breaks_nm == (60.0, 240.0)


def test_a_preset_without_limits_decides_nothing(printed: Print) -> None:
    asked = (analyze, TRACE, RECIPE, None, NO_RUNS)
    found = json.loads(printed(*asked, code=3, selection=Selection("harmonic"), as_json=True))
    assert found["verdict"] == "NOT DECIDABLE"
    assert "no metric has a limit: there is nothing to decide" in found["reasons"]


def test_a_preset_that_leaves_a_limit_out_passes_nothing(printed: Print, tmp_path: Path) -> None:
    """The one limit that it judges is kept; the others of the recipe are named."""
    simple = simple_acceptance(tmp_path, RECIPE)
    found = json.loads(
        printed(analyze, TRACE, simple, None, NO_RUNS, code=3, selection=Selection("inverse"), as_json=True)
    )
    assert {metric["verdict"] for metric in found["metrics"]} == {"PASS", None}
    assert found["verdict"] == "NOT DECIDABLE"
    assert found["reasons"][0] == (
        "preset inverse leaves out metrics that have limits in the recipe: lost_motion, spring_constant, "
        "stiffness_50_100, torque_ratio_offset"
    )


def test_a_limit_of_the_recipe_fails_by_a_preset_too(printed: Print, tmp_path: Path) -> None:
    simple = simple_acceptance(tmp_path, RECIPE)
    asked = (analyze, TRACE, simple, None, NO_RUNS)
    found = json.loads(printed(*asked, code=1, selection=Selection("measurement"), as_json=True))
    assert found["verdict"] == "FAIL"
    told = "spring_constant, side -: 45.74 N·m/arcmin is below the limit of 108 N·m/arcmin"
    assert reads(found["reasons"][0], told)


def test_the_stiffness_curve_shows_what_was_chosen() -> None:
    method = Method(ratio=121, rated_torque_nm=412, stiffness_break_t1_nm=60.0, stiffness_break_t2_nm=240.0)
    wanted = [MetricWanted("k1"), MetricWanted("k3"), MetricWanted("spring_constant", fit="three_region")]
    result = analyse(read_trace(Path(TRACE)), method, wanted)
    figure = stiffness_figure(result, method, judged_in(result).metrics)
    assert figure is not None
    (axes,) = figure.axes
    named = [text.get_text().split("\n")[0] for text in axes.get_legend().get_texts()]
    assert {"k1", "k3", "spring_constant three_region"} <= set(named)
    k1, k3 = (result.metrics[place].sides[0].value for place in (0, 1))
    lines = [(line.get_xdata(), line.get_ydata()) for line in axes.lines if len(line.get_xdata()) == 2]
    spans = {(round(x[0], 6), round(x[1], 6)): y[0] for x, y in lines}
    assert spans[0.0, 60.0] == pytest.approx(k1)
    assert spans[240.0, 412.0] == pytest.approx(k3)


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
    found: Any = json.loads(printed(repeat, repeats, RECIPE, Selection("nabtesco"), NO_RUNS, as_json=True))
    assert found["runs"] == repeats
    by_name = {(metric["id"], metric["side"]): metric for metric in found["metrics"]}
    backlash = by_name["backlash_width_zero", "both"]["repeatability"]
    assert backlash["run_values"] == [pytest.approx(0.9408, abs=5e-5), pytest.approx(0.9596, abs=5e-5)]
    assert backlash["sd_runs"] == pytest.approx(0.02 * 0.9408 / 2**0.5, abs=5e-5)
    assert backlash["sd_cycles"] is None
    assert set(by_name) == {("backlash_width_zero", "both"), ("lost_motion", "both"),
                            ("stiffness_50_100", "+"), ("stiffness_50_100", "-")}  # fmt: skip
    shown = printed(repeat, repeats, RECIPE, Selection("nabtesco"), NO_RUNS, as_json=False)
    assert words(METRICS["lost_motion"].text) in words(shown)
    done = here("repeatability", *repeats, "--recipe", RECIPE, "--metric", "lost_motion band=5%", "--json")
    (single,) = done.json["metrics"]
    assert (single["id"], single["choices"]) == ("lost_motion", ["band 5 %"])
    assert single["repeatability"]["sd_runs"] > 0.0


def test_one_run_is_no_repeat(repeats: list[str]) -> None:
    with pytest.raises(StationError, match="expected 2 or more of one unit"):
        repeat([repeats[0], repeats[0]], RECIPE, OWN, NO_RUNS, as_json=True)
    with pytest.raises(StationError, match="--recipe is missing"):
        repeat(repeats, None, OWN, NO_RUNS, as_json=True)


SINGLE = ("windup", "stiffness_at torque=50 % branch=load", "spring_constant fit=three_region", "lost_motion band=5%")


def test_single_metrics_are_reported_with_their_choices(printed: Print) -> None:
    asked = (analyze, TRACE, RECIPE, None, NO_RUNS)
    found = json.loads(printed(*asked, code=3, selection=Selection(metrics=SINGLE), as_json=True))
    assert (found["preset"], found["selection"]) == (None, [f"metric {one}" for one in SINGLE])
    assert [metric["id"] for metric in found["metrics"]] == [one.split()[0] for one in SINGLE]
    assert [metric["value"] is None for metric in found["metrics"]] == [False] * len(SINGLE)
    assert [metric["choices"] for metric in found["metrics"]] == [[], [], ["three_region"], ["band 5 %"]]
    shown = words(printed(*asked, code=3, selection=Selection("nabtesco", SINGLE), as_json=False))
    assert words(f"preset nabtesco, metric {SINGLE[0]}, metric {SINGLE[1]}") in shown
    for metric in found["metrics"]:
        assert words(metric["definition"]) in shown


def test_nothing_passes_by_a_single_metric_that_leaves_out_what_the_recipe_limits(tmp_path: Path) -> None:
    recipe = simple_acceptance(tmp_path, RECIPE)
    found = elsewhere(Path(TRACE), recipe, "virtual", Selection(metrics=("backlash_width_3pct",)))
    assert [(one.id, one.verdict) for one in found.metrics] == [("backlash_width_3pct", "PASS")]
    assert found.verdict == "NOT DECIDABLE"
    assert found.reasons[0].startswith("metric backlash_width_3pct leaves out metrics that have limits in the recipe: ")
    both = elsewhere(Path(TRACE), recipe, "virtual", Selection(metrics=("backlash_width_3pct", "windup")))
    assert "metric backlash_width_3pct, metric windup leave out metrics" in both.reasons[0]


def test_a_single_metric_of_the_command_line_is_refused_with_its_place() -> None:
    asked = ("analyze", TRACE, "--recipe", RECIPE, "--metric", "windup", "--metric", "stifness_at torque=50%", "--json")
    done = here(*asked)
    assert done.exit_code == 2
    assert "--metric 'stifness_at torque=50%': id: found the unknown metric 'stifness_at'; allowed: " in done.err
    (error,) = done.json["errors"]
    assert (error["option"], error["line"], error["hint"]) == ("id", None, "Did you mean 'stiffness_at'?")
