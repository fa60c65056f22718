"""Options that a form changes: the line of the option changes, and no comment is lost."""

from __future__ import annotations

import difflib
from pathlib import Path

import pytest

from recipes import RecipeError, parse_recipe, shipped_recipes
from recipes.editing import all_changed, changed, limits_of, load_of
from recipes.text.problems import OptionPath
from recipes.text.yaml_source import parse_source


def lines_between(before: bytes, now: bytes) -> list[str]:
    found = difflib.ndiff(before.decode().splitlines(), now.decode().splitlines())
    return [line for line in found if line[0] in "+-"]


@pytest.mark.parametrize("path", shipped_recipes().values(), ids=lambda path: path.stem)
def test_what_a_form_changes_is_one_line_of_the_text_and_no_comment(path: Path) -> None:
    content = path.read_bytes()
    source = parse_source(content, path.name)
    groups = [*limits_of(source), *load_of(source)]
    fields = [field for group in groups for field in group.fields]
    assert len({field.option for field in fields}) == len(fields) >= 6
    same = [(field.option, field.value) for field in fields if field.value]
    assert all_changed(content, same) == content, "the same values change nothing"
    for field in fields:
        now = changed(content, field.option, "7 arcmin")
        removed, added = lines_between(content, now)
        assert removed[0] == "-"
        assert f"{field.option[-1]}: 7 arcmin" in added
        assert removed.partition("#")[2].strip() == added.partition("#")[2].strip()
        if not field.value:
            assert changed(now, field.option, "").split() == content.split(), "taken out again, it is as before"


def test_a_changed_recipe_is_loaded_with_the_new_values() -> None:
    before = content = shipped_recipes()["rv-40e-121-quick"].read_bytes()
    changes: list[tuple[OptionPath, str]] = [
        (("metrics", 0, "max"), "1.2 arcmin"),
        (("metrics", 4, "min"), "100 N·m·arcmin"),
        (("metrics", 1, "max"), ""),
        (("sequence", 3, "torque_cycles", "count"), "3"),
        (("recipe", "revision"), "17"),
    ]
    for option, value in changes:
        content = changed(content, option, value)
    assert all_changed(before, changes) == content, "changed at once, they give the text that they give one by one"
    recipe = parse_recipe(content, "r")
    assert (recipe.metrics[0].max, recipe.metrics[4].min, recipe.recipe.revision) == (1.2, 100.0, 17)
    assert recipe.sequence[3].count == 3


def test_lists_that_are_not_indented_stay_so() -> None:
    content = b"# above\nrecipe:\n  name: a   # its name\nmetrics:\n- {id: lost_motion, max: 1 arcmin}  # why\n"
    now = changed(content, ("metrics", 0, "max"), "2 arcmin")
    assert now == content.replace(b"1 arcmin", b"2 arcmin")


@pytest.mark.parametrize(
    ("option", "value"),
    [
        (("metrics", 0, "max"), "{a: 1}"),
        (("metrics", 0, "max"), "[1]"),
        (("metrics", 0, "max"), "1\nb: 2"),
        (("metrics", 0, "max"), "*a"),
        (("metrics", 99, "max"), "1"),
        (("no", "such"), "1"),
    ],
)
def test_what_is_no_value_or_has_no_place_is_refused(option: tuple[str | int, ...], value: str) -> None:
    with pytest.raises(RecipeError):
        changed(shipped_recipes()["rv-40e-121-quick"].read_bytes(), option, value)


@pytest.mark.parametrize("content", [b"a: &x 1\nb: *x", b"[", b"recipe", b"recipe: 5"])
def test_a_text_that_is_no_recipe_is_not_changed(content: bytes) -> None:
    with pytest.raises(RecipeError):
        changed(content, ("recipe", "revision"), "2")
