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


COMMENTED = b"""\
recipe:
  name: a   # the name
  revision: 1
# about the limits
metrics:
  - {id: lost_motion, # lm
     max: 1 arcmin    # as agreed
    }
  - id: backlash_width_3pct   # in lines
    max: '1 arcmin'   # quoted
  # the last
decision:
  rule: simple  # for now
"""
CHANGES: list[tuple[OptionPath, str, bytes, bytes]] = [
    (("metrics", 0, "max"), "2 arcmin", b"max: 1 arcmin  ", b"max: 2 arcmin  "),
    (("metrics", 0, "min"), "0.1 arcmin", b"1 arcmin    #", b"1 arcmin, min: 0.1 arcmin    #"),
    (("metrics", 0, "max"), "", b"     max: 1 arcmin    #", b"         #"),
    (("metrics", 1, "max"), "2 arcmin", b"'1 arcmin'", b"2 arcmin"),
    (("metrics", 1, "max"), "", b"max: '1 arcmin'   # q", b"   # q"),
    (("metrics", 1, "min"), "1", b"# quoted\n", b"# quoted\n    min: 1\n"),
    (("decision", "guard_factor"), "0.9", b"# for now\n", b"# for now\n  guard_factor: 0.9\n"),
    (("recipe", "revision"), "2", b"revision: 1", b"revision: 2"),
    (("recipe", "revision"), "", b"  revision: 1\n", b""),
    (("recipe", "name"), '"true"', b"name: a ", b'name: "true" '),
    (("recipe", "name"), "b, {c}", b"name: a ", b"name: b, {c} "),
    (("metrics", 0, "max"), "1, {c}", b"max: 1 arcmin", b'max: "1, {c}"'),
]


@pytest.mark.parametrize("line_end", [b"\n", b"\r\n"], ids=["unix", "windows"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"], ids=["", "marked"])
@pytest.mark.parametrize(("option", "value", "before", "now"), CHANGES)
def test_no_other_character_changes(  # noqa: PLR0917 - one change, in each kind of file
    option: OptionPath, value: str, before: bytes, now: bytes, mark: bytes, line_end: bytes
) -> None:
    """A comment in a section of one line was lost, and every line end became another."""
    assert COMMENTED.count(before) == 1
    as_file = [mark + text.replace(b"\n", line_end) for text in (COMMENTED, COMMENTED.replace(before, now))]
    assert changed(as_file[0], option, value) == as_file[1]


@pytest.mark.parametrize("path", shipped_recipes().values(), ids=lambda path: path.stem)
def test_a_file_with_line_ends_of_windows_keeps_them(path: Path) -> None:
    content = path.read_bytes()
    source = parse_source(content, path.name)
    for group in (*limits_of(source), *load_of(source)):
        for field in group.fields:
            now = changed(content.replace(b"\n", b"\r\n"), field.option, "7 arcmin")
            assert now == changed(content, field.option, "7 arcmin").replace(b"\n", b"\r\n")


@pytest.mark.parametrize(
    "text", ["a:\n  b: |\n    c\n", "a:\n  b:\n    - 1\n", "a:\n  b: [1] # c\n", "a:\n  b: >-\n    c\nd: 1\n"]
)
@pytest.mark.parametrize("value", ["2", ""])
def test_what_cannot_be_changed_alone_is_left_to_the_text(text: str, value: str) -> None:
    with pytest.raises(RecipeError, match=r"recipe:[23]:.*a\.b.*Change it in the text\.$"):
        changed(text.encode(), ("a", "b"), value)


@pytest.mark.parametrize("option", [("metrics", 0, "max"), ("metrics", 0, "min"), ("recipe", "revision")])
def test_a_name_that_is_there_twice_is_told_at_its_place(option: OptionPath) -> None:
    """Nobody can say which of the two a form changes."""
    content = COMMENTED.replace(b"max: 1 arcmin ", b"max: 1 arcmin, max: 3 arcmin")
    with pytest.raises(RecipeError, match=r"recipe:7:21: metrics\[0\]\.max: found 'max' a second time") as refused:
        changed(content, option, "2 arcmin")
    assert "Delete one of the two." in str(refused.value)


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_an_option_that_stands_there_without_a_value_is_filled(line_end: str) -> None:
    text = "a:\n  min:   # to come\n  max: 2\n".replace("\n", line_end).encode()
    assert changed(text, ("a", "min"), "5") == text.replace(b"min:", b"min: 5")
