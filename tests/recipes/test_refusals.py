"""Wrong files: each is refused at its line and column, with the words that a technician needs."""

from __future__ import annotations

import re
from enum import StrEnum
from pathlib import Path

import pytest
from pydantic import BaseModel, ConfigDict, Field
from refusal_support import problems

from recipes import (
    RecipeError,
    find_recipe,
    load_bench,
    load_document,
    load_recipe,
    parse_bench,
    parse_recipe,
    shipped_benches,
    shipped_recipes,
)
from recipes.text.yaml_source import parse_source, refuse_misleading

GOOD = shipped_recipes()["rv-40e-121-inverse"].read_text(encoding="utf-8")


def place_of(mark: str, text: str = GOOD) -> tuple[int, int]:
    """Line and column of the first appearance of a text."""
    before = text[: text.index(mark)].split("\n")
    return len(before), len(before[-1]) + 1


# In the good recipe `old` becomes `new`; the only problem must stand at the first appearance of `at` in the new text.
CASES = {
    "unknown option": (
        "torque_rate: 60 N·m/s, dwell: 200", "torque_rat: 60 N·m/s, dwell: 200", "torque_rat:",
        ["sequence[2].calibrate.torque_rat: found the unknown option 'torque_rat'",
         "allowed: peak_torque, torque_rate or dwell", "Did you mean 'torque_rate'?"],
    ),
    "attribute's name": (
        "rated_torque: 412", "rated_torque_nm: 412", "rated_torque_nm", ["Did you mean 'rated_torque'?"],
    ),
    "unknown section": ("decision:\n", "descision:\n", "descision", ["Did you mean 'decision'?"]),
    "missing option": (
        ", max_motion: 0.2 arcmin", "", "lock:",
        ["sequence[1].lock.max_motion: found nothing", "the option 'max_motion', which is required", "Add it."],
    ),
    "missing section": (
        "decision:\n  rule: guard_band ", "# ", "recipe:", ["decision: found nothing", "the option 'decision'"],
    ),
    "no unit": ("412 N·m", "412", "412\n", ["found 412 without a unit", "'412 N·m'"]),
    "wrong dimension": (
        "torque_rate: 60 N·m/s, dwell: 200", "torque_rate: 60 N·m, dwell: 200", "60 N·m, ",
        ["sequence[2].calibrate.torque_rate: found '60 N·m', which is a torque",
         "allowed: a torque rate such as '60 N·m/s', above 0 and up to 1000 N·m/s",
         "Write it with a torque rate unit."],
    ),
    "unknown unit": ("60 deg ", "60 dge ", "60 dge", ["'60 dge', whose unit is not known", "Did you mean 'deg'?"]),
    "zero rate": (
        "torque_rate: 100 N·m/s", "torque_rate: 0 N·m/s", "0 N·m/s}\n  - rel",
        ["found '0 N·m/s'", "above 0", "too small"],
    ),
    "too large": (
        "period: 1 ms", "period: 1 s", "1 s", ["sampling.period", "from 0.5 up to 20 ms", "too large"],
    ),
    "percentage too large": (
        "proof_torque: 10 %", "proof_torque: 10000 %", "10000 %", ["found '10000 %', which is 41200 N·m", "20000 N·m"],
    ),
    "percentage of nothing": ("torque_in_tare: 0.05 N·m", "torque_in_tare: 1 %", "1 %", ["which is a fraction"]),
    "number with a unit": ("ratio: 121", "ratio: 121 turns", "121 turns", ["found '121 turns'", "a number"]),
    "whole number": ("count: 3", "count: 3.5", "3.5", ["found 3.5", "a whole number"]),
    "text for a number": ("count: 3", "count: 'x'", "'x'", ["found 'x'", "a whole number"]),
    "count of zero": ("count: 3", "count: 0", "0, peak", ["found 0", "a number from 1"]),
    "choice": ("loading: input ", "loading: inptu ", "inptu", ["found 'inptu'", "input or output", "mean 'input'?"]),
    "name with a space": ("name: rv-40e", "name: rv 40e", "rv 40e", ["a short name without spaces"]),
    "number for a text": ("model: RV-40E-121", "model: 40", "40\n", ["found 40", "a text", "Put it in quotes."]),
    "section is a text": (
        "  rule: guard_band ", "  simple ", "simple ", ["decision: found 'simple'", "a section with the options rule"],
    ),
    "section is empty": ("  rule: guard_band ", "# ", "decision:", ["decision: found nothing", "rule or guard_factor"]),
    "list is a text": (
        re.search(r"metrics:\n(.*\n)+?\n", GOOD)[0], "metrics: all\n\n", "all\n", ["metrics: found 'all'", "a list"],
    ),
    "unknown step": (
        "- calibrate:", "- calibarte:", "{peak_torque", ["the unknown step 'calibarte'", "Did you mean 'calibrate'?"],
    ),
    "step without options": ("- unload: {torque_rate: 100 N·m/s}", "- unload", "unload\n", ["'- unload: {...}'"]),
    "step badly indented": (
        "- unload: {torque_rate: 100 N·m/s}", "- unload:\n    torque_rate: 100 N·m/s", "unload:\n",
        ["torque_rate in the same step as 'unload'", "Indent the options of unload further"],
    ),
    "no unload": (
        "  - unload: {torque_rate: 100 N·m/s}\n", "", "sequence:",
        ["a sequence without 'unload'", "unload, release", "a wound-up reducer stores energy"],
    ),
    "no cycles": (
        re.search(r"  - torque_cycles.*\n", GOOD)[0], "", "sequence:", ["a sequence without cycles", "torque_cycles"],
    ),
    "two locks": (
        "  - calibrate:",
        "  - lock: {holding_torque: 1 N·m, proof_torque: 1 N·m, max_motion: 1 arcmin}\n  - calibrate:",
        "lock: {holding_torque: 1 N·m", ["sequence[2]: found a second 'lock'", "Delete one"],
    ),
    "alarm above trip": (
        "torque_out_alarm: 114 %", "torque_out_alarm: 121 %", "121 %",
        ["found an alarm at 498.52 N·m", "below torque_out_trip, 494.4 N·m"],
    ),
    "min above max": (
        "{id: lost_motion, max: 1", "{id: lost_motion, min: 2 arcmin, max: 1", "2 arcmin, max",
        ["metrics[2].min: found min 2 arcmin", "a min up to max, 1 arcmin"],
    ),
    "unknown metric": (
        "id: lost_motion", "id: lostmotion", "lostmotion",
        ["the unknown metric 'lostmotion'", "Did you mean 'lost_motion'?"],
    ),
    "limit in another dimension": (
        "min: 108 N·m/arcmin", "min: 108 arcmin", "108 arcmin", ["metrics[3].min", "which is an angle", "a stiffness"],
    ),
    "limit with a unit for a number": (
        "{id: torque_ratio_slope}", "{id: torque_ratio_slope, min: 90 N·m}", "90 N·m}", ["a number", "without a unit"],
    ),
    "branch of another metric": (
        "{id: stiffness_lsq}", "{id: stiffness_lsq, branch: mean}", "mean}\n  - {id: stiffness_two",
        ["found 'mean' for stiffness_lsq", "allowed: load"],
    ),
    "torque of another metric": (
        "{id: stiffness_lsq}", "{id: stiffness_lsq, torque: 50 %}", "50 %}\n  - {id: stiffness_two",
        ["a torque for stiffness_at", "part of its definition"],
    ),
    "guard factor without guard band": (
        "rule: guard_band ", "rule: simple\n  guard_factor: 1.2 ", "1.2", ["with 'rule: guard_band' only"],
    ),
    "duplicated option": (
        "loading: input ", "loading: input\nloading: output ", "loading: output   ",
        ["loading: found 'loading' a second time (first in line 14)", "Delete one of the two."],
    ),
    "anchor": ("rule: guard_band ", "rule: &rule guard_band ", "&rule", ["an anchor ('&rule')"]),
    "form of a number": ("ratio: 121", "ratio: -_", "-_", ["unit_under_test.ratio: found '-_'", "a number"]),
    "surrogate as a name": (
        "loading: input ", 'loading: input\n"\\ud800": 1 ', '"\\ud800"', ["?: found the unknown option '?'"],
    ),
    "tag": ("rule: guard_band ", "rule: !!str guard_band ", "!!str", ["a tag"]),
    "second document": ("decision:\n", "---\ndecision:\n", "---", ["a second document ('---')"]),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_refused_at_its_place_in_words(name):
    old, new, at, words = CASES[name]
    assert old in GOOD
    text = GOOD.replace(old, new, 1)
    line, column = place_of(at, text)
    (message,) = problems(text)
    assert message.startswith(f"r.yaml:{line}:{column}: "), message
    for word in words:
        assert word in message


WHOLE_FILES = {
    "empty": (b"", "1:1:", "an empty file"),
    "only comments": (b"# nothing\n\n", "1:1:", "an empty file"),
    "null": (b"null\n", "1:1:", "an empty file"),
    "a word": (b"recipe\n", "1:1:", "found 'recipe'; allowed: a section with the options recipe, unit_under_test"),
    "a list": (b"- 1\n", "1:1:", "found a list"),
    "utf-16": ("recipe: {}\n".encode("utf-16"), "1:1:", "a file in UTF-16; allowed: text in UTF-8"),
    "latin-1": ("a: 1\nb: 5 N·m\n".encode("latin-1"), "2:7:", "the byte 0xB7, which is not UTF-8 (it is '·'"),
    "binary": (b"\x00\x01\x02", "1:1:", "control character U+0000"),
    "control character": (b"a: 1\nb: \x07\n", "2:4:", "control character U+0007"),
    "tab": (b"a:\n\tb: 1\n", "2:1:", "Indent with spaces"),
    "colon": (b"a: b: c\n", "1:5:", "mapping values are not allowed"),
    "quote": (b"a: 'b\n", "2:1:", "ends too early"),
    "bracket": (b"a: {b: 1\nc: 2\n", "2:2:", "Close the bracket"),
    "alias": (b"a: &x [1]\nb: *x\n", "1:4:", "an anchor"),
    "billion laughs": (b"a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n", "1:4:", "an anchor"),
    "deep": (b"[" * 5000, "1:17:", "nested too deep"),
    "large": (b"a: 1\n" * 40000, "1:1:", "more than 128 kB"),
    "alias as a name": (b"a: 1\n*b : 2\n", "2:1:", "an alias as a name"),
    "yaml 1.1": (b"%YAML 1.1\n---\nrecipe: no\n", "2:1:", "a directive ('%')"),
    "tag directive": (b"%TAG ! tag:x,2000:\n---\na: !b 1\n", "2:1:", "a directive ('%')"),
    "list as a name": (b"? [a]\n: 1\n", "1:3:", "a list or section as a name"),
    "tag of python": (b"a: !!python/object/apply:os.system ['x']\n", "1:4:", "a tag"),
}


@pytest.mark.parametrize("name", WHOLE_FILES)
def test_no_recipe_at_all(name):
    raw, place, words = WHOLE_FILES[name]
    message = problems(raw)[0]
    assert message.startswith(f"r.yaml:{place}"), message
    assert words in message


def test_all_problems_at_once_in_the_order_of_the_file():
    text = GOOD
    for old, new in (
        ("412 N·m", "412 N"),
        ("loading: input", "loading: input\nloading: output"),
        ("max_motion: 0.2 arcmin", "max_motion: 0.2"),
        ("  - unload: {torque_rate: 100 N·m/s}\n", ""),
        ("period: 1 ms", "perod: 1 ms"),
        ("rule: guard_band", "rule: guardband"),
        ("{id: lost_motion, max: 1", "{id: lost_motion, min: 2 arcmin, max: 1"),
    ):
        text = text.replace(old, new, 1)
    found = problems(text)
    places = [tuple(int(part) for part in message.split(":")[1:3]) for message in found]
    assert len(found) == 7, found
    assert places == sorted(places)


def test_a_wrong_rated_torque_is_one_problem_and_not_one_per_percentage():
    assert len(problems(GOOD.replace("412 N·m", "412 N", 1))) == 1


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("none.yaml", "no such file"),
        (".", "a folder"),
        ("nul\0.yaml", "cannot be read"),
        ("x" * 5000, "cannot be read"),
    ],
)
def test_what_cannot_be_opened(tmp_path, name, words):
    with pytest.raises(RecipeError, match=words):
        load_bench(tmp_path / name)


@pytest.mark.parametrize("name", ["rv-40e-121-invers", "rv-40e-121-invers.yaml"])
def test_a_misspelt_recipe_names_the_shipped_one(name):
    with pytest.raises(RecipeError, match="Did you mean 'rv-40e-121-inverse'"):
        find_recipe(name)


def test_unreadable_file(tmp_path, monkeypatch):
    def refuse(*_arguments, **_options):
        raise PermissionError(13, "Permission denied")

    path = tmp_path / "r.yaml"
    path.write_text("a: 1\n")
    monkeypatch.setattr("os.open", refuse)
    with pytest.raises(RecipeError, match=r"cannot be read \(Permission denied\)"):
        load_document(path, Wire)


class Colour(StrEnum):
    RED = "red"
    BLUE = "blue"


class Wire(BaseModel):
    """A model of another package: plain pydantic, without sections or quantities."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    index: int
    colour: Colour = Colour.RED
    scale: float = Field(default=1.0, gt=0)
    parts: tuple[Wire, ...] = ()
    tag: str | None = None
    names: dict[str, int] = Field(default_factory=dict)


def test_models_of_other_packages(tmp_path):
    path = tmp_path / "wire.yaml"
    path.write_text("index: 0x1018\ncolour: blue\nscale: 2\nparts: [{index: 1}]\nnames: {a: 1}\n")
    loaded = load_document(path, Wire)
    assert loaded == Wire(index=0x1018, colour=Colour.BLUE, scale=2.0, parts=(Wire(index=1),), names={"a": 1})
    path.write_text("index: '1'\ncolour: bleu\nscale: -1\nparts:\n  - {index: 1, clour: red}\nnames: {a: true}\n")
    with pytest.raises(RecipeError) as caught:
        load_document(path, Wire)
    for line, words in zip(
        str(caught.value).splitlines(),
        ("wire.yaml:1:8: index: found '1'; allowed: a whole number",
         "wire.yaml:2:9: colour: found 'bleu'; allowed: red or blue. Did you mean 'blue'?",
         "wire.yaml:3:8: scale: found -1; allowed: a number above 0",
         "wire.yaml:5:16: parts[0].clour: found the unknown option 'clour'",
         "wire.yaml:6:12: names.a: found true; allowed: a whole number"),
        strict=True,
    ):  # fmt: skip
        assert words in line
    path.write_text("index: 1\nparts:\n  - {index: 1, tag: }\ntag:\n")
    with pytest.raises(RecipeError) as caught:
        load_document(path, Wire)
    assert [one.option for one in caught.value.problems] == ["parts[0].tag", "tag"], "a value was meant"


def test_a_decimal_comma_in_a_section_of_one_line_is_told_as_one() -> None:
    """Its halves were told as two mistakes, and the first advice was to write 60 N·m/s."""
    text = GOOD.replace("torque_rate: 60 N·m/s, dwell: 200", "torque_rate: 60,5 N·m/s, dwell: 200")
    with pytest.raises(RecipeError) as refused:
        parse_recipe(text.encode(), "r.yaml")
    (found,) = refused.value.problems
    assert found.option == "sequence[2].calibrate.torque_rate"
    assert "'60,5 N·m/s'" in found.found
    assert "'60.5 N·m/s'" in found.allowed
    assert "decimal sign as a point" in found.hint


UNLOAD = "unload: {torque_rate: 100 N·m/s}"
COMMAS = {
    "1.200,5 N·m/s": ["'1200.5 N·m/s'"],
    "1,200.5 N·m/s": ["'1200.5 N·m/s'"],
    "1,600 N·m/s": ["'1.600 N·m/s'", "'1600 N·m/s'"],
    "0,600 N·m/s": ["'0.600 N·m/s'"],
    "12,25 N·m/s": ["'12.25 N·m/s'"],
}


@pytest.mark.parametrize("text", COMMAS)
def test_a_comma_is_told_with_every_number_that_may_be_meant(text: str) -> None:
    """Who followed the advice for 1.200,5 wrote 1.2, and who meant 1600 wrote 1.6."""
    with pytest.raises(RecipeError) as refused:
        parse_recipe(GOOD.replace(UNLOAD, UNLOAD.replace("100 N·m/s", text)).encode(), "r.yaml")
    (found,) = refused.value.problems
    assert found.option.endswith("unload.torque_rate")
    assert found.allowed.split(" or ") == COMMAS[text]
    assert found.found.startswith(f"'{text}'")


NOT_PLAIN = {
    "ratio: 121,5": ("allowed: 121.5", "decimal sign"),
    "ratio: 1,215": ("allowed: 1.215 or 1215", "decimal sign"),
    "ratio: 121:1": ("allowed: a number", "Write 121."),
    "ratio: 121 arcmin": ("allowed: a number", "without a unit"),
    "ratio: '121'": ("allowed: a number", "without quotes"),
    "ratio: many": ("allowed: a number", "in digits"),
    "revision: two": ("allowed: a whole number", "in digits"),
    "revision: 2.5": ("allowed: a whole number", "without decimals"),
    "metrics:": ("allowed: a list", "below its name"),
}


@pytest.mark.parametrize("line", NOT_PLAIN)
def test_what_is_no_plain_value_is_told_with_what_to_do(line: str) -> None:
    name, words = line.split(":", maxsplit=1)[0], NOT_PLAIN[line]
    if name == "metrics":
        text = GOOD[: GOOD.index("metrics:")] + "metrics:\n" + GOOD[GOOD.index("decision:") :]
    else:
        text = re.sub(rf"(?m)^  {name}: \d+$", f"  {line}", GOOD)
    (found,) = problems(text)
    assert all(one in found for one in words), found


def test_a_file_of_the_other_kind_is_told_in_one_line() -> None:
    bench = shipped_benches()["virtual"].read_bytes()
    for read, raw, words in ((parse_recipe, bench, "--bench"), (parse_bench, GOOD.encode(), "a recipe")):
        with pytest.raises(RecipeError) as refused:
            read(raw, "r.yaml")
        (found,) = refused.value.problems
        assert words in str(found)


@pytest.mark.parametrize("place", ["# a comment {}\nname: a\n", "name: a{}b\n"])
@pytest.mark.parametrize("character", ["\u202e", "\u2066", "\u200f"])
def test_characters_that_turn_the_text_are_refused_wherever_they_stand(place: str, character: str) -> None:
    with pytest.raises(RecipeError) as refused:
        parse_source(place.format(character).encode(), "r.yaml")
    (problem,) = refused.value.problems
    assert f"U+{ord(character):04X}" in problem.found
    assert problem.column > 1


@pytest.mark.parametrize(
    "place", ["a: 1\n# a comment{}max: 3\nname: a\n", "a: 1\nname: a{}b\n", "a: 1\nb: {{c: 1, #{}d: 2\n}}\n"]
)
@pytest.mark.parametrize("character", ["\u2028", "\u2029", "\x85", "\r"])
def test_characters_that_end_a_line_for_the_parser_alone_are_refused_wherever_they_stand(
    place: str, character: str
) -> None:
    with pytest.raises(RecipeError) as refused:
        refuse_misleading(place.format(character).encode(), "r.yaml")
    (problem,) = refused.value.problems
    assert f"U+{ord(character):04X}, which ends a line for some programs" in problem.found
    assert (problem.line, problem.column) == (2, place.split("\n")[1].replace("{{", "{").index("{}") + 1)
    assert "U+000A" in problem.allowed
    assert "press Enter" in problem.hint


@pytest.mark.parametrize("kind", ["recipe", "bench"])
def test_a_comment_sets_no_limit_behind_the_sign_that_ends_it(tmp_path: Path, kind: str) -> None:
    """For an editor the limit is a part of the comment, for YAML it is the limit. Copies in records open as ever."""
    text = GOOD if kind == "recipe" else shipped_benches()["virtual"].read_text(encoding="utf-8")
    first = text.index(": ") + 1
    file = tmp_path / "r.yaml"
    file.write_bytes((text[:first] + " # it was\u2028 " + text[first:]).encode())
    with pytest.raises(RecipeError, match=r"r\.yaml:\d+:\d+: found the character U\+2028"):
        (load_recipe if kind == "recipe" else load_bench)(file)
    assert (parse_recipe if kind == "recipe" else parse_bench)(f"{text}\n# a hy\u00adphen\n".encode(), "r.yaml")


@pytest.mark.parametrize("character", ["\u200b", "\u200d", "\u2060", "\ufeff", "\xad", "\u180e"])
def test_characters_that_no_editor_shows_are_refused_in_texts_and_comments(character: str) -> None:
    """Behind them '#' begins no comment: the text below would have it in its value."""
    for text in (f"a: 1\nname: b {character}# c\n", f"a: 1\nname: b # {character}c\n"):
        with pytest.raises(RecipeError) as refused:
            refuse_misleading(text.encode(), "r.yaml")
        (problem,) = refused.value.problems
        assert f"U+{ord(character):04X}, which no editor shows" in problem.found
        assert (problem.line, problem.column) == (2, text.split("\n")[1].index(character) + 1)


@pytest.mark.parametrize("character", ["\x0b", "\x0c", "\x1c", "\x1d", "\x1e", "\x1f"])
def test_the_other_line_ends_of_programs_are_refused_as_control_characters(character: str) -> None:
    with pytest.raises(RecipeError, match=f"r.yaml:1:8: found the control character U\\+{ord(character):04X}"):
        parse_source(f"a: 1 # {character}b: 2\n".encode(), "r.yaml")


def test_line_ends_of_windows_wide_blanks_and_a_byte_order_mark_at_the_start_are_read() -> None:
    text = "\ufeffa: 1  # a\u3000note\u00a0\r\nb: 5\u00a0N\r\n"
    refuse_misleading(text.encode(), "r.yaml")
    assert parse_source(text.encode(), "r.yaml").data == {"a": 1, "b": "5\u00a0N"}
