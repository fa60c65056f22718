"""Limits of metrics: one that no unit can fail, or none can meet, is refused; one that is not usual is told."""

from __future__ import annotations

import pytest

from definitions.metrics import METRICS, Scale
from recipes import RecipeError, check, check_alone, default_bench, parse_recipe, shipped_recipes, warnings
from recipes.checks.limits import DECIDES, SCALES

INVERSE = shipped_recipes()["rv-40e-121-inverse"].read_text("utf-8")


def recipe(metric: str):
    start, end = INVERSE.index("metrics:"), INVERSE.index("validity:")
    return parse_recipe((INVERSE[:start] + f"metrics:\n  - {metric}\n\n" + INVERSE[end:]).encode(), "r.yaml")


def test_every_metric_has_its_kind_of_limit():
    assert all(row.usual.least < row.usual.most for row in METRICS.values())
    assert {row.bad.side for row in METRICS.values()} <= set(DECIDES)
    assert set(SCALES) == set(Scale)


NEVER_FAILS = {
    "{id: grade, max: 2}": "max 2 for 'grade', which no unit fails; allowed: a max below 2, the largest possible value",
    "{id: grade, max: 7}": "max 7 for 'grade'",
    "{id: grade, min: 1}": "min 1 for 'grade', which no unit fails; allowed: a max",
    "{id: backlash_width_3pct, min: 0 arcmin}": "min 0 arcmin for 'backlash_width_3pct', which no unit fails",
    "{id: backlash_width_3pct, min: -1 arcmin}": "min -1 arcmin",
    "{id: lost_motion, min: 0 arcmin}": "allowed: a max",
    "{id: stiffness_lsq, min: 0 N·m/arcmin}": "allowed: a min above 0 N·m/arcmin",
    "{id: hysteresis_angle, min: 0 arcsec}": "which no unit fails",
    "{id: torque_ratio_slope, min: 0}": "which no unit fails",
}


@pytest.mark.parametrize("metric", NEVER_FAILS)
def test_a_limit_that_no_unit_can_fail_is_refused(metric):
    loaded = recipe(metric)
    (problem,) = check_alone(loaded)
    assert NEVER_FAILS[metric] in str(problem)
    assert problem.option.startswith("metrics[0].")
    assert problem in check(loaded, default_bench(loaded)[1])


EMPTY = {
    "{id: backlash_width_3pct, max: }": "metrics[0].max",
    "{id: backlash_width_3pct, max: null}": "metrics[0].max",
    "{id: stiffness_lsq, min: 95 N·m/arcmin, max: ~}": "metrics[0].max",
    "{id: lost_motion, max: 1 arcmin, max_standard_deviation: }": "metrics[0].max_standard_deviation",
    "{id: lost_motion, max: 1 arcmin, tolerance: }": "metrics[0].tolerance",
    "{id: lost_motion, max: 1 arcmin, band: }": "metrics[0].band",
}


@pytest.mark.parametrize("metric", EMPTY)
def test_an_option_with_nothing_behind_it_is_refused_where_it_would_decide(metric):
    loaded = recipe(metric)  # a record that has such a recipe opens
    (problem,) = check_alone(loaded)
    assert problem.option == EMPTY[metric]
    assert problem in check(loaded, default_bench(loaded)[1])


@pytest.mark.parametrize(("where", "option"), [("decision:", "guard_factor"), ("interlocks:", "torque_rate")])
def test_an_empty_option_is_refused_in_every_section(where, option):
    text = INVERSE.replace(f"\n{where}\n", f"\n{where}\n  {option}:\n")
    loaded = parse_recipe(text.encode(), "r.yaml")
    assert [problem.option for problem in check(loaded, default_bench(loaded)[1])] == [f"{where[:-1]}.{option}"]


NEVER_MET = {
    "{id: backlash_width_3pct, max: -1 arcmin}": "metrics[0].max",
    "{id: backlash_width_zero, max: 0 arcmin}": "metrics[0].max",
    "{id: lost_motion, max: -1 arcmin}": "metrics[0].max",
    "{id: lost_motion, min: -2 arcmin, max: -1 arcmin}": "metrics[0].max",
    "{id: stiffness_lsq, max: -1 N·m/arcmin}": "metrics[0].max",
    "{id: grade, max: 0}": "metrics[0].max",
    "{id: grade, min: 3}": "metrics[0].min",
    "{id: grade, max: 1}": None,
    "{id: grade, min: 2}": None,
    "{id: torque_ratio_offset, min: -30 N·m, max: -5 N·m}": None,
}


@pytest.mark.parametrize("metric", NEVER_MET)
def test_a_limit_that_no_unit_can_meet_is_refused(metric):
    loaded, option = recipe(metric), NEVER_MET[metric]
    assert [problem.option for problem in check_alone(loaded)] == ([] if option is None else [option])
    refused = [problem.option for problem in check(loaded, default_bench(loaded)[1])]
    assert option is None or option in refused


@pytest.mark.parametrize("name", METRICS)
def test_a_limit_on_the_side_that_decides_nothing_is_told_of_every_metric(name):
    row = METRICS[name]
    other = "max" if row.bad.side == "low" else "min"
    unit = "" if row.unit == "1" else f" {row.unit}"
    inside = row.usual.most * SCALES[row.usual.of](recipe("{id: windup}")) or -1.0
    told = warnings(recipe(f"{{id: {name}, {other}: {inside:.6g}{unit}}}"))
    assert [one.option for one in told] == [f"metrics[0].{other}"]


IMPLAUSIBLE = {
    "{id: backlash_width_3pct, max: 1 deg}": "found 60 arcmin for 'backlash_width_3pct'; usual is one from 0.01 arcmin",
    "{id: backlash_width_3pct, max: 1 arcsec}": None,
    "{id: backlash_width_3pct, max: 0.1 arcsec}": "found 0.001667 arcmin",
    "{id: backlash_width_3pct, min: 0.5 arcmin}": "'backlash_width_3pct' with min alone; usual is a max, the side that",
    "{id: backlash_width_3pct, min: 0 arcmin, max: 1 arcmin}": None,
    "{id: backlash_width_3pct, min: 0.2 arcmin, max: 1 arcmin}": None,
    "{id: stiffness_lsq, min: 108 N·m/rad}": "found 0.03142 N·m/arcmin for 'stiffness_lsq'",
    "{id: stiffness_lsq, max: 108 N·m/arcmin}": "too little of it passes",
    "{id: stiffness_lsq, min: 95 N·m/arcmin, max: 2000 N·m/arcmin}": "(0.1 to 3 of the unit's catalogue stiffness)",
    "{id: k1, min: 40 N·m/arcmin}": None,
    "{id: windup, max: 10 arcmin}": None,
    "{id: windup, max: 10 deg}": "found 600 arcmin for 'windup'",
    "{id: hysteresis_energy, max: 600 N·m·arcmin}": None,
    "{id: asymmetry_at_rated, max: 30 arcsec}": None,
    "{id: asymmetry_at_rated, max: 30 arcmin}": "found 1800 arcsec",
    "{id: torque_ratio_slope, min: 9.4}": "found 9.4 for 'torque_ratio_slope'; usual is one from 60.5 to 123.4",
    "{id: torque_ratio_offset, min: 25 N·m}": "found 25 N·m for 'torque_ratio_offset'",
    "{id: torque_ratio_offset, min: -2500 N·m}": "found -2500 N·m",
    "{id: lost_motion, band: 0.03 %, max: 0.3 arcmin}": "a band of 0.03 %",
    "{id: lost_motion, band: 30 %, max: 0.3 arcmin}": "a band of 30 %",
    "{id: lost_motion, band: 0.03 %}": None,
    "{id: lost_motion, band: 1 %, max: 0.3 arcmin}": None,
    "{id: lost_motion, band: 10 %, max: 0.3 arcmin}": None,
}


@pytest.mark.parametrize("metric", IMPLAUSIBLE)
def test_a_limit_that_is_not_usual_is_told_and_not_refused(metric):
    loaded, words = recipe(metric), IMPLAUSIBLE[metric]
    assert check_alone(loaded) == []
    told = [one.as_warning() for one in warnings(loaded)]
    assert len(told) == (words is not None), told
    assert words is None or words in told[0]


@pytest.mark.parametrize(("reference", "told"), [("30 %", True), ("3 N·m", True), ("50 %", False), ("412 N·m", False)])
def test_a_reference_torque_far_from_the_rated_one_is_told_where_something_is_limited(reference, told):
    text = INVERSE.replace("\nmeasurement:\n", f"\nmeasurement:\n  reference_torque: {reference}\n")
    loaded = parse_recipe(text.encode(), "r.yaml")
    assert [one.option for one in warnings(loaded)] == ["measurement.reference_torque"] * told
    unlimited = text[: text.index("metrics:")] + "metrics:\n  - {id: grade}\n\n" + text[text.index("validity:") :]
    assert warnings(parse_recipe(unlimited.encode(), "r.yaml")) == []


@pytest.mark.parametrize(("rule", "told"), [
    ("guard_band\n  guard_factor: 0", True),
    ("guard_band\n  guard_factor: 0.5", True),
    ("guard_band\n  guard_factor: 0.82", False),
    ("simple", False),
])  # fmt: skip
def test_a_guard_band_that_is_next_to_none_is_told(rule, told):
    loaded = parse_recipe(INVERSE.replace("rule: guard_band ", f"rule: {rule} ").encode(), "r.yaml")
    assert loaded.decision.rule == rule.split()[0]
    assert [one.option for one in warnings(loaded)] == ["decision.guard_factor"] * told


@pytest.mark.parametrize("name", shipped_recipes())
def test_the_limits_of_shipped_recipes_are_usual(name):
    loaded = parse_recipe(shipped_recipes()[name].read_bytes(), name)
    assert [*check_alone(loaded), *warnings(loaded)] == []


SPREADS = {
    "{id: lost_motion, max_standard_deviation: 0.5 arcsec}": None,
    "{id: lost_motion, max: 1 arcmin, max_standard_deviation: 0 arcmin}": "a standard deviation above 0",
    "{id: torque_ratio_slope, max_standard_deviation: 0.1}": "one value",
    "{id: grade, max_standard_deviation: 1}": "limit the backlash instead",
}


@pytest.mark.parametrize("metric", SPREADS)
def test_a_limit_on_the_spread_over_the_cycles_is_read_in_the_unit_of_its_metric(metric):
    said = SPREADS[metric]
    if said is None:
        loaded = recipe(metric)
        (wanted,) = loaded.metrics
        assert wanted.max_standard_deviation == pytest.approx(0.5 / 60)
        assert wanted.limited
        assert check(loaded, default_bench(loaded)[1]) == []
        return
    with pytest.raises(RecipeError, match=said):
        recipe(metric)


@pytest.mark.parametrize(("cycles", "refused"), [(1, True), (2, False)])
def test_a_limit_on_the_spread_of_one_cycle_is_refused(cycles, refused):
    start, end = INVERSE.index("metrics:"), INVERSE.index("validity:")
    text = INVERSE[:start].replace("count: 3", f"count: {cycles}") + "metrics:\n  - " + next(iter(SPREADS)) + "\n\n"
    loaded = parse_recipe((text + INVERSE[end:]).encode(), "r.yaml")
    found = [problem.option for problem in check(loaded, default_bench(loaded)[1])]
    assert ("metrics[0].max_standard_deviation" in found) is refused
