"""Shipped files: they load, they mean what they say, and no damage to them breaks the loader."""

from __future__ import annotations

import math
import pickle
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.loop.method import MetricWanted as AnalysisMetric
from analysis.metrics.wanted import definition
from recipes import (
    PRESETS,
    RecipeError,
    check,
    default_bench,
    load_bench,
    load_recipe,
    parse_bench,
    parse_recipe,
    shipped_benches,
    shipped_recipes,
)
from recipes.schema.metric_schema import PresetName, preset_metrics
from recipes.schema.sequence_schema import STAGES
from recipes.text.section import option_name

RECIPES = {name: path.read_bytes() for name, path in shipped_recipes().items()}
BENCHES = {name: path.read_bytes() for name, path in shipped_benches().items()}


@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_is_named_like_its_file(name):
    assert load_recipe(shipped_recipes()[name]).recipe.name == name
    assert load_recipe(name).recipe.name == name


@pytest.mark.parametrize("name", BENCHES)
def test_a_bench_is_named_like_its_file(name):
    bench = load_bench(shipped_benches()[name])
    assert load_bench(name) == bench
    assert bench.bench.name == name


def test_the_quantities_of_the_inverse_recipe():
    recipe = load_recipe("rv-40e-121-inverse")
    assert [step.kind for step in recipe.sequence] == [
        "home", "lock", "calibrate", "torque_cycles", "unload", "release",
    ]  # fmt: skip
    home, lock, calibrate, cycles, unload, release = recipe.sequence
    assert recipe.unit_under_test.rated_torque_nm == 412.0
    assert recipe.unit_under_test.loading_torque_ratio.offset_nm == -13.9
    assert home.tare_time_s == pytest.approx(0.2)
    assert (lock.proof_torque_nm, lock.proof_time_s) == (pytest.approx(41.2), 0.2)
    assert lock.max_motion_rad == pytest.approx(0.2 * math.pi / 10800)
    assert calibrate.peak_torque_nm == pytest.approx(453.2)
    assert (cycles.count, cycles.torque_rate_nm_s, cycles.dwell_s) == (3, 60.0, 0.5)
    assert (unload.torque_rate_nm_s, release.max_torque_nm) == (100.0, pytest.approx(8.24))
    assert recipe.sampling.period_ns == 1_000_000
    assert isinstance(recipe.sampling.period_ns, int)
    assert recipe.sampling.missed_periods_fraction == pytest.approx(0.01)
    assert recipe.interlocks.speed_rad_s == pytest.approx(2 * math.pi)
    assert recipe.interlocks.housing_temperature_c == 60.0
    assert recipe.measurement.reference_torque_nm == 412.0
    at_half = next(metric for metric in recipe.metrics if metric.id == "stiffness_at")
    assert at_half.torque_nm == pytest.approx(206.0)


def test_percentages_of_metrics_are_of_the_reference_torque():
    text = RECIPES["rv-40e-121-output"].decode().replace("- {id: windup}", "- {id: stiffness_at, torque: 50 %}")
    recipe = parse_recipe(text.encode(), "r.yaml")
    assert recipe.measurement.reference_torque_nm == 300.0
    assert recipe.metrics[-1].torque_nm == pytest.approx(150.0)


@pytest.mark.parametrize(
    ("rule", "factor"),
    [
        ("simple", 0.0),
        ("guard_band", 0.8225),
        ("guard_band\n  guard_factor: 1", 1.0),
        ("guard_band\n  guard_factor: 0", 0),
    ],
)
def test_guard_factor_follows_the_rule(rule, factor):
    text = RECIPES["rv-40e-121-inverse"].decode().replace("rule: guard_band ", f"rule: {rule} ")
    assert parse_recipe(text.encode(), "r.yaml").decision.guard_factor == factor


def test_shipped_recipes_pass_nothing_that_the_uncertainty_leaves_open():
    assert {load_recipe(name).decision.guard_factor for name in RECIPES} == {0.8225}


def test_default_benches():
    names = {name: default_bench(load_recipe(name))[1].bench.name for name in RECIPES}
    assert names["static-50nm"] == "virtual-static"
    assert names["rv-40e-121-output"] == "virtual-output"
    assert {names[name] for name in names if "121" in name and "output" not in name} == {"virtual"}


def test_loaded_files_cross_to_another_process():
    recipe = load_recipe("rv-40e-121-inverse")
    again = pickle.loads(pickle.dumps(recipe))  # noqa: S301
    assert again == recipe
    assert check(again, load_bench("virtual-output"))[0].line > 1


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_whole(name):
    row = PRESETS[name]
    assert all((row.text, row.reference, row.breaks, row.metrics))
    for metric in preset_metrics(name):
        assert (metric.min, metric.max) == (None, None)
        definition(
            AnalysisMetric(metric.id, branch=metric.branch, band=metric.band, variant=metric.variant, fit=metric.fit)
        )
    keys = [metric.key(412.0) for metric in preset_metrics(name)]
    assert len(set(keys)) == len(keys)


def test_every_preset_can_be_named():
    assert set(get_args(PresetName)) == set(PRESETS)


def test_every_kind_of_step_is_shipped():
    shipped = {step.kind for name in RECIPES for step in load_recipe(name).sequence}
    assert shipped == set(STAGES)


@pytest.mark.parametrize(
    ("attribute", "option"),
    [("torque_rate_nm_s", "torque_rate"), ("stiffness_nm_per_arcmin", "stiffness"),
     ("acceleration_rad_s2", "acceleration"),
     ("steps", "steps"), ("poll_every_s", "poll_every"), ("resolution_bits", "resolution"), ("period_ns", "period"),
     ("housing_temperature_c", "housing_temperature"), ("torque_constant_nm_per_a", "torque_constant")],
)  # fmt: skip
def test_options_are_attributes_without_unit(attribute, option):
    assert option_name(attribute) == option


def check_problems(error: RecipeError) -> None:
    assert error.problems
    assert all(one.line >= 1 and one.column >= 1 and str(one) for one in error.problems)


def load_anything(raw: bytes) -> None:
    for parse in (parse_recipe, parse_bench):
        try:
            loaded = parse(raw, "r.yaml")
        except RecipeError as error:
            check_problems(error)
        else:
            assert loaded.model_dump()


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=120) | st.text(max_size=120).map(lambda text: text.encode("utf-8", "surrogatepass")))
def test_any_bytes_are_loaded_or_refused(raw):
    load_anything(raw)


@settings(max_examples=120, deadline=None)
@given(
    name=st.sampled_from(sorted(RECIPES)),
    start=st.integers(0, 3000),
    length=st.integers(0, 40),
    new=st.binary(max_size=6)
    | st.sampled_from([b"{", b"[", b": ", b"\n  - ", b"*a", b"&a ", b"!!int ", b"'", b"\t", b"? "]),
)
def test_damaged_recipes_are_loaded_or_refused(name, start, length, new):
    raw = RECIPES[name]
    start = min(start, len(raw))
    load_anything(raw[:start] + new + raw[start + length :])


@settings(max_examples=80, deadline=None)
@given(data=st.data())
def test_recipes_with_any_values_are_loaded_or_refused(data):
    lines = RECIPES[data.draw(st.sampled_from(sorted(RECIPES)))].decode().split("\n")
    numbers = [index for index, line in enumerate(lines) if ":" in line and not line.startswith("#")]
    value = data.draw(
        st.sampled_from(
            [
                "",
                "null",
                "1e400 N·m",
                "-5 %",
                "{}",
                "[]",
                "[1, 2]",
                "{a: 1}",
                ".nan",
                "0x1F",
                "2020-01-01",
                "yes",
                "9" * 5000,
            ]
        )
    )
    for index in data.draw(st.lists(st.sampled_from(numbers), min_size=1, max_size=3)):
        lines[index] = lines[index].split(":")[0] + ": " + value
    load_anything("\n".join(lines).encode())


@pytest.mark.parametrize("name", shipped_recipes())
def test_while_samples_stay_away_the_torque_comes_no_further_than_the_alarm(name):
    """A ramp goes on for as long as `interlocks.sample_age` lets it, from its peak at the worst."""
    recipe = load_recipe(name)
    reached_nm = [
        step.peak_torque_nm + step.torque_rate_nm_s * recipe.interlocks.sample_age_s
        for step in recipe.sequence
        if hasattr(step, "peak_torque_nm") and hasattr(step, "torque_rate_nm_s")
    ]
    assert max(reached_nm, default=0.0) < recipe.interlocks.torque_out_alarm_nm
