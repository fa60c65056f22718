"""Presets and choices in a recipe: what is asked for, and what is refused where it stands."""

from __future__ import annotations

import re

import pytest

from recipes import RecipeError, Selection, check, load_bench, parse_recipe, selected, shipped_recipes

GOOD = shipped_recipes()["rv-40e-121-inverse"].read_text(encoding="utf-8")
METRICS = re.search(r"metrics:\n(.*\n)+?\n", GOOD)[0]


def recipe_with(metrics: str, text: str = GOOD):
    return parse_recipe(text.replace(METRICS, f"{metrics}\n").encode(), "r.yaml")


def test_a_preset_alone():
    recipe = recipe_with("presets: [harmonic]\n")
    wanted = recipe.wanted()
    assert [metric.id for _, metric in wanted] == ["k1", "k2", "k3", "lost_motion", "backlash_width_zero"]
    assert {place for place, _ in wanted} == {("presets", 0)}
    assert wanted[3][1].band == 0.04
    assert check(recipe, load_bench("virtual")) == []


def test_presets_beside_metrics_ask_for_each_definition_once():
    recipe = recipe_with(
        "presets: [nabtesco, spinea]\nmetrics:\n  - {id: lost_motion, max: 1 arcmin}\n"
        "  - {id: stiffness_50_100, branch: load}\n"
    )
    found = [(place, metric.id, metric.branch, metric.max) for place, metric in recipe.wanted()]
    assert found == [
        (("metrics", 0), "lost_motion", None, 1.0),
        (("metrics", 1), "stiffness_50_100", "load", None),
        (("presets", 0), "backlash_width_zero", None, None),
        (("presets", 1), "stiffness_50_100", "mean", None),
    ]
    assert check(recipe, load_bench("virtual")) == []


def test_limits_of_the_recipe_hold_for_a_preset_where_the_definition_is_the_same():
    recipe = parse_recipe(GOOD.encode(), "r.yaml")
    by_id = {metric.id: metric for metric in selected(recipe, Selection("nabtesco"))}
    assert (by_id["lost_motion"].max, by_id["stiffness_50_100"].min) == (1.0, 95.0)
    assert {metric.min for metric in selected(recipe, Selection("inverse")) if metric.id == "spring_constant"} == {None}
    (measured,) = [one for one in selected(recipe, Selection("measurement")) if one.id == "spring_constant"]
    assert measured.min == 108.0


def test_a_definition_is_the_same_with_its_defaults_written_out():
    recipe = recipe_with(
        "metrics:\n  - {id: spring_constant}\n"
        "  - {id: spring_constant, variant: ending, fit: six_segment, branch: mean}\n"
    )
    (problem,) = check(recipe, load_bench("virtual"))
    assert "metrics[1].id: found 'spring_constant' a second time" in str(problem)


def test_choices_are_loaded():
    recipe = recipe_with(
        "metrics:\n  - {id: spring_constant, variant: centred, fit: three_region, min: 100 N·m/arcmin}\n"
        "  - {id: windup, variant: direct}\n  - {id: hysteresis_angle, torque: 30 %, max: 0.5 arcmin}\n"
        "  - {id: gear_clearance, side: +, variant: intercept}\n  - {id: grade, variant: lost_motion, max: 1}\n"
    )
    spring, windup, angle, clearance, grade = recipe.metrics
    assert (spring.variant, spring.fit, windup.variant) == ("centred", "three_region", "direct")
    assert (angle.torque_nm, angle.max) == (pytest.approx(123.6), pytest.approx(30.0))
    assert (clearance.side, clearance.variant, grade.max) == ("+", "intercept", 1.0)
    assert check(recipe, load_bench("virtual")) == []


def test_break_torques():
    text = GOOD.replace("  calibration: measured ", "  break_torque: 90 N·m\n  break_torque_t1: 15 %\n"
                        "  break_torque_t2: 60 %\n  calibration: measured ")  # fmt: skip
    measurement = parse_recipe(text.encode(), "r.yaml").measurement
    assert measurement.break_torque_nm == 90.0
    assert measurement.break_torque_t1_nm == pytest.approx(61.8)
    assert measurement.break_torque_t2_nm == pytest.approx(247.2)


REFUSED = {
    "unknown preset": ("presets: [inverse, nabtesko]\n", (1, 20), ["presets[1]", "'nabtesko'", "mean 'nabtesco'"]),
    "preset twice": ("presets: [inverse, inverse]\n", (1, 20), ["presets[1]", "'inverse' a second time"]),
    "no list": ("presets: inverse\n", (1, 10), ["presets: found 'inverse'", "a list"]),
    "nothing at all": ("presets: []\n", None, ["metrics: found neither metrics nor presets"]),
    "unknown variant": (
        "metrics:\n  - {id: windup, variant: directly}\n", (2, 27),
        ["metrics[0].variant", "fitted or direct", "'direct'?"],
    ),
    "variant of none": (
        "metrics:\n  - {id: stiffness_lsq, variant: direct}\n", (2, 34), ["stiffness_lsq has no variant to choose"],
    ),
    "unknown fit": (
        "metrics:\n  - {id: windup, fit: six_segments}\n", (2, 23), ["metrics[0].fit", "mean 'six_segment'"],
    ),
    "fit that is not read": (
        "metrics:\n  - {id: windup, variant: direct, fit: three_region}\n", (2, 40), ["metrics[0].fit", "uses no fit"],
    ),
    "limit in another unit": (
        "metrics:\n  - {id: k1, min: 30 arcsec}\n", (2, 19), ["metrics[0].min", "which is an angle", "a stiffness"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refusals(case):
    metrics, place, said = REFUSED[case]
    with pytest.raises(RecipeError) as caught:
        recipe_with(metrics)
    (problem,) = caught.value.problems
    before = GOOD[: GOOD.index(METRICS)].count("\n")
    if place is not None:
        assert (problem.line - before, problem.column) == place
    for words in said:
        assert words in str(problem)


@pytest.mark.parametrize(
    ("options", "option", "said"),
    [
        ({"break_torque": "500 N·m"}, "break_torque", "below the reference torque, 412 N·m"),
        ({"break_torque_t1": "70 %", "break_torque_t2": "20 %"}, "break_torque_t2", "above break_torque_t1, 288.4 N·m"),
        ({"break_torque_t1": "20 %"}, "break_torque_t1", "both break torques or none"),
        ({"break_torque_t2": "20 %"}, "break_torque_t2", "both break torques or none"),
    ],
)
def test_break_torques_that_cannot_be(options, option, said):
    lines = "".join(f"  {name}: {value}\n" for name, value in options.items())
    text = GOOD.replace("  calibration: measured ", f"{lines}  calibration: measured ")
    with pytest.raises(RecipeError) as caught:
        parse_recipe(text.encode(), "r.yaml")
    (problem,) = caught.value.problems
    assert problem.option == f"measurement.{option}"
    assert said in str(problem)
    assert text.split("\n")[problem.line - 1].strip().startswith(f"{option}:")


def test_a_metric_of_a_preset_beyond_the_cycles_is_found_at_the_preset():
    text = shipped_recipes()["rv-40e-121-output"].read_text(encoding="utf-8").replace("  reference_torque: 300 N·m", "")
    (asked,) = re.findall(r"presets:(?:.*\n)+?\nmetrics:\n(?:.*\n)+?\n", text)
    recipe = parse_recipe(text.replace(asked, "presets: [nabtesco]\n\n").encode(), "r.yaml")
    (problem,) = check(recipe, load_bench("virtual-output"))
    assert problem.option == "presets[0]"
    assert "'stiffness_50_100', which is read at 412 N·m" in str(problem)
