"""Wrong recipes: each is refused with its place, what was found, what is allowed, and the nearest valid name."""

from __future__ import annotations

import contextlib
import datetime as dt
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recipes import RecipeError, check, default_bench, load_bench, load_recipe, shipped_benches, shipped_recipes

GOOD = shipped_recipes()["rv-40e-121-inverse"].read_text(encoding="utf-8")


def problems_of(text: str | bytes, folder: Path) -> list[str]:
    """Everything that is said against a recipe, without the folder."""
    path = folder / "recipe.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    try:
        recipe = load_recipe(path)
    except RecipeError as error:
        found = list(error.problems)
    else:
        found = check(recipe, default_bench(recipe)[1], path)
    return [str(problem).replace(f"{folder}/", "") for problem in found]


def changed(old: str, new: str) -> str:
    assert old in GOOD, old
    return GOOD.replace(old, new, 1)


def line_of(text: str) -> int:
    return GOOD[: GOOD.index(text)].count("\n") + 1


CAL = "calibrate: {peak_torque: 110 %, torque_rate: 60 N·m/s"
CASES: dict[str, tuple[str | bytes, int, tuple[str, ...]]] = {
    # name: (text, line, words in the first message)
    "unknown key": (
        changed(CAL, "calibrate: {peak_torqe: 110 %, torque_rate: 60 N·m/s"), line_of(CAL),
        ("sequence[2].calibrate.peak_torque: this key is missing",),
    ),
    "wrong dimension": (
        changed(CAL, CAL.replace("N·m/s", "N·m")), line_of(CAL),
        ("sequence[2].calibrate.torque_rate", "found '60 N·m', which is a torque", "such as '60 N·m/s'"),
    ),
    "no such unit": (
        changed("rated_torque: 412 N·m", "rated_torque: 412 Nmm"), line_of("rated_torque: 412"),
        ("unit_under_test.rated_torque", "'Nmm' is not a unit"),
    ),
    "no unit": (
        changed("max_motion: 0.2 arcmin", "max_motion: 0.2"), line_of("max_motion"),
        ("sequence[1].lock.max_motion", "bare number 0.2"),
    ),
    "out of range": (
        changed(CAL, CAL.replace("60", "6e9")), line_of(CAL), ("out of range", "above 0 up to 1000 N·m/s"),
    ),
    "above the rating of the unit": (
        changed("torque_cycles: {count: 3, peak_torque: 110 %", "torque_cycles: {count: 3, peak_torque: 250 %"),
        line_of("holding_torque"), ("lock that has to bear 1030 N·m",),
    ),
    "above the input sensor": (
        changed("torque_cycles: {count: 3, peak_torque: 110 %", "torque_cycles: {count: 3, peak_torque: 113 %"),
        line_of("torque_cycles"), ("sequence[3].torque_cycles.peak_torque", "above its sensor", "up to 459.6 N·m"),
    ),
    "above the brake": (
        changed("holding_torque: 600 N·m", "holding_torque: 1200 N·m"), line_of("holding_torque"),
        ("sequence[1].lock.holding_torque", "up to 1000 N·m (10 A)"),
    ),
    "lock too weak": (
        changed("holding_torque: 600 N·m", "holding_torque: 460 N·m"), line_of("holding_torque"),
        ("498.52 N·m or more",),
    ),
    "never reaches its target": (
        changed("torque_out_alarm: 114 %", "torque_out_alarm: 109 %"), line_of("- calibrate"),
        ("never reached: the alarm at 449.08 N·m",),
    ),
    "alarm above trip": (
        changed("torque_out_alarm: 114 %", "torque_out_alarm: 121 %"), line_of("torque_out_alarm"),
        ("not below the trip",),
    ),
    "no unload": (re.sub(r"  - unload.*\n", "", GOOD), line_of("  - home"), ("no 'unload' step",)),
    "wrong order": (
        GOOD.replace("  - home", "  - release: {max_torque: 2 %}\n  - home").replace(
            "  - release: {max_torque: 2 %}\n\nsampling", "\nsampling",
        ),
        line_of("  - home") + 1, ("sequence[1]", "'home' stands after 'release'"),
    ),
    "unknown step": (
        changed("calibrate:", "calibarte:"), line_of("calibrate: {"), ("sequence[2]", "Did you mean 'calibrate'?"),
    ),
    "min above max": (
        changed("{id: lost_motion, max: 1 arcmin}", "{id: lost_motion, min: 2 arcmin, max: 1 arcmin}"),
        line_of("{id: lost_motion"), ("metrics[2].min", "min 2 above max 1"),
    ),
    "unknown metric": (
        changed("id: lost_motion", "id: lost_motoin"), line_of("id: lost_motion"), ("Did you mean 'lost_motion'?",),
    ),
    "limit in another dimension": (
        changed("min: 108 N·m/arcmin", "min: 108 arcmin"), line_of("min: 108"), ("metrics[3].min", "which is an angle"),
    ),
    "unknown choice": (changed("rule: simple", "rule: simpel"), line_of("rule: simple"), ("Did you mean 'simple'?",)),
    "duplicated key": (
        changed("loading: input", "loading: input\nloading: output"), line_of("loading: input") + 1,
        ("the key 'loading' stands twice", "first in line 14"),
    ),
    "wrong side for the bench": (
        changed("output_torque: reaction ", "output_torque: calibrated ").replace("  - calibrate:", "  #"),
        line_of("  calibration:"), ("the sequence has no calibrate step",),
    ),
    "syntax": (changed("metrics:\n", "metrics:\n - {id: a\n"), line_of("metrics:") + 2, ("YAML syntax",)),
    "tab": (changed("  period: 1 ms", "\tperiod: 1 ms"), line_of("  period"), ("YAML syntax", "not tabs")),
    "empty": ("", 0, ("the file is empty",)),
    "encoding": (GOOD.encode("utf-16"), 1, ("is not UTF-8",)),
    "latin-1": (GOOD.encode("latin-1", "replace"), 0, ("not UTF-8",)),
    "list": ("- 1\n", 1, ("instead of sections",)),
    "alias": ("a: &x [1]\nb: *x\n", 1, ("an anchor or alias",)),
    "deep": ("[" * 300 + "]" * 300, 1, ("nested deeper",)),
    "two documents": (GOOD + "\n---\na: 1\n", GOOD.count("\n") + 2, ("a second YAML document",)),
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(CASES))
def test_refused_with_its_place_and_reason(name, tmp_path):
    text, line, words = CASES[name]
    found = problems_of(text, tmp_path)
    assert found, "accepted"
    matching = [message for message in found if all(word in message for word in words)]
    assert matching, found
    if line:
        assert matching[0].startswith(f"recipe.yaml:{line}:"), matching[0]


def test_all_problems_at_once_in_the_order_of_the_file(tmp_path):
    text = GOOD
    for old, new in (("0.2 arcmin", "0.2"), ("rule: simple", "rule: simpel"), ("period: 1 ms", "period: 1 mm")):
        text = text.replace(old, new, 1)
    found = problems_of(text, tmp_path)
    assert len(found) == 3
    lines = [int(message.split(":")[1]) for message in found]
    assert lines == sorted(lines)


def test_a_file_that_is_not_there_and_a_folder(tmp_path):
    for path, words in ((tmp_path / "none.yaml", "no such file"), (tmp_path, "this is a folder")):
        with pytest.raises(RecipeError, match=words):
            load_recipe(path)


@pytest.mark.parametrize("name", sorted(shipped_recipes()))
def test_shipped_recipes_are_accepted_on_their_default_bench(name):
    path = shipped_recipes()[name]
    recipe = load_recipe(path)
    assert recipe.recipe.name == name
    assert check(recipe, default_bench(recipe)[1], path) == []


@pytest.mark.parametrize("name", sorted(shipped_benches()))
def test_shipped_benches_are_accepted(name):
    assert load_bench(shipped_benches()[name]).bench.name == name


def test_example_bench_serves_a_recipe_with_a_stored_calibration(tmp_path):
    text = GOOD.replace("output_torque: reaction ", "output_torque: calibrated ").replace(
        "calibration: measured ", "calibration: stored ",
    )  # fmt: skip
    path = tmp_path / "stored.yaml"
    path.write_text(re.sub(r"  - calibrate.*\n|.*torque_ratio_(slope|offset).*\n", "", text), encoding="utf-8")
    recipe, bench = load_recipe(path), load_bench(shipped_benches()["example-socketcan"])
    assert check(recipe, bench, path, dt.date(2026, 6, 1)) == []
    late = check(recipe, bench, path, dt.date(2027, 6, 1))
    assert ["was due on 2027-03-02" in str(problem) for problem in late] == [True]


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_are_refused_in_our_own_words(tmp_path_factory, raw):
    path = tmp_path_factory.mktemp("bytes") / "r.yaml"
    path.write_bytes(raw)
    with pytest.raises(RecipeError):
        load_recipe(path)


@settings(max_examples=150, deadline=None)
@given(start=st.integers(0, len(GOOD) - 1), length=st.integers(0, 12), new=st.text(max_size=6))
def test_a_mutilated_recipe_never_crashes(tmp_path_factory, start, length, new):
    text = GOOD[:start] + new + GOOD[start + length :]
    # no embedded bench for a changed loading side: also a refusal in our own words
    with contextlib.suppress(RecipeError):
        problems_of(text.encode("utf-8", "surrogatepass"), tmp_path_factory.mktemp("mutant"))
