"""What a validation error means to the person who wrote the file: found, allowed, what to do.

One row of `ALLOWED` per error type of pydantic that a document can cause; a type without a row is reported in
pydantic's own words. Which options a section has is read off the model's JSON schema, whatever package it is of.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from recipes.text.problems import Mark, OptionPath, Problem, Source, did_you_mean, excerpt, one_of
from recipes.text.quantity import meant_by
from recipes.text.section import reader
from recipes.text.yaml_source import LONGEST_NUMBER

WHOLE = "a whole number"
NUMBER = "a number"
DATE = "a date such as 2025-03-31"

ALLOWED: dict[str, tuple[str, str]] = {
    "int_type": (WHOLE, "Write it in digits, without decimals."),
    "int_parsing_size": (WHOLE, "This is too large."),
    "float_type": (NUMBER, "Write it in digits."),
    "finite_number": (NUMBER, "Infinity is not a value."),
    "bool_type": ("true or false", ""),
    "string_type": ("a text", "Put it in quotes."),
    "string_too_long": ("a text of at most {max_length} characters", "Make it shorter."),
    "greater_than": ("a number above {gt:g}", "This is too small."),
    "greater_than_equal": ("a number from {ge:g}", "This is too small."),
    "less_than_equal": ("a number up to {le:g}", "This is too large."),
    "tuple_type": ("a list (lines that begin with '- ', or [..., ...])", "Write its entries below its name."),
    "too_short": ("a list of at least {min_length} entries", "Add an entry."),
    "too_long": ("a list of at most {max_length} entries", "Shorten the list."),
    "date_type": (DATE, ""),
    "date_parsing": (DATE, ""),
}

PATTERNS = {
    r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$": "a short name without spaces, made of letters, digits and . _ + -",
    r"^[A-Za-z0-9_.:-]+$": "a host name or address such as 192.168.0.10",
    r"^\S+$": "a path without spaces, such as /dev/ttyUSB0",
}
"""Patterns of `recipes.text.section` in words."""

BEHIND_COMMA = re.compile(r"[0-9]+(\s*[^0-9\s].*)?")
"""What YAML makes of the rest of `{torque: 110,5 N·m}`: an option without a value."""

UNKNOWN_OPTION = ("extra_forbidden", "unexpected_keyword_argument")
"""Error types of an option that a section, or a dataclass, does not have."""

QUOTED = re.compile(r"'([^']*)'")


TO_ONE = re.compile(r"\s*([0-9]+(?:\.[0-9]+)?)\s*:\s*1\s*")
"""A ratio as people write it."""

NUMBER_FIRST = re.compile(r"\s*[+-]?\.?[0-9][0-9.]*([eE][+-]?[0-9]+)?\s*(?P<behind>.*)", re.DOTALL)
"""A text that begins with a number, and what comes behind it."""


def decimal_commas(source: Source) -> Iterator[tuple[OptionPath, OptionPath, str]]:
    """Yield each number that a comma cut in two within `{...}`: both options that YAML made of it, and its text."""
    yield from _decimal_commas(source.data, (), source.marks)


def _decimal_commas(
    data: Any, place: OptionPath, marks: Mapping[OptionPath, Mark]
) -> Iterator[tuple[OptionPath, OptionPath, str]]:
    if isinstance(data, list):
        for index, inner in enumerate(data):
            yield from _decimal_commas(inner, (*place, index), marks)
    if not isinstance(data, dict):
        return
    before: tuple[str, Any] = ("", None)
    for name, value in data.items():
        if value is None and isinstance(before[1], int | float) and BEHIND_COMMA.fullmatch(str(name)):
            whole, rest = (*place, before[0]), (*place, name)
            yield whole, rest, f"{_as_written(before[1], marks[whole], marks[rest])},{name}"
        yield from _decimal_commas(value, (*place, name), marks)
        before = (name, value)


def _as_written(value: float, here: Mark, behind: Mark) -> str:
    """Return a number with the zeroes that stand at its end: of `1.200,5` YAML reads 1.2."""
    text = str(value)
    room = behind.name_column - here.column - 1 if behind.name_line == here.line else 0
    return text.ljust(room, "0") if "." in text and room <= LONGEST_NUMBER else text


def _number_as_text(text: str, allowed: str) -> tuple[str, str, str]:
    """Return found, allowed and hint for a text in the place of a plain number."""
    meant, hint = meant_by(text)
    if meant:
        plain = [one for one in meant if allowed != WHOLE or "." not in one]
        return f"{excerpt(text)}, with a comma", one_of(plain) or allowed, hint
    if ratio := TO_ONE.fullmatch(text):
        return excerpt(text), allowed, f"Write {ratio[1]}."
    number = NUMBER_FIRST.fullmatch(text)
    way = "in digits" if number is None else "without a unit" if number["behind"] else "without quotes"
    return excerpt(text), allowed, hint or f"Write it {way}."


def problem_of(error: Mapping[str, Any], source: Source, model: type[Any]) -> Problem:
    """Return one of pydantic's error details as a problem with its place in the document."""
    place, kind, context = tuple(error["loc"]), error["type"], error.get("ctx") or {}
    option, found, hint = _in_document(place, source), excerpt(error["input"]), ""
    at_name = kind in ("missing", *UNKNOWN_OPTION)
    if at_name:
        option = (*_in_document(place[:-1], source), place[-1])
    match kind:
        case "refused":
            found, allowed, hint = context["found"], context["allowed"], context["hint"]
            option += tuple(int(part) if part.isdigit() else part for part in context["at"].split(".") if part)
        case "missing":
            found, allowed, hint = "nothing", f"the option '{place[-1]}', which is required", "Add it."
        case _ if kind in UNKNOWN_OPTION:
            names = options_at(model, place[:-1])
            found, allowed = f"the unknown option {excerpt(place[-1])}", one_of(names) or "no options"
            hint = did_you_mean(place[-1], names) or "Delete it."
        case "model_type" | "dataclass_type":
            names = options_at(model, place)
            allowed = f"a section with the options {one_of(names)}" if names else "a section (lines of name: value)"
            hint = "Write its options indented below its name." if place else "Copy a shipped file and edit it."
        case "float_type" | "int_type" if isinstance(error["input"], str):
            found, allowed, hint = _number_as_text(error["input"], ALLOWED[kind][0])
        case "literal_error" | "enum":
            choices = QUOTED.findall(context["expected"]) or [str(context["expected"])]
            allowed, hint = one_of(choices), did_you_mean(str(error["input"]), choices)
        case "string_pattern_mismatch":
            allowed = PATTERNS.get(context["pattern"], f"a text of the form {context['pattern']}")
        case _:
            own_words = error["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
            allowed, hint = ALLOWED.get(kind, (own_words, ""))
            allowed = allowed.format(**context) if kind in ALLOWED else allowed
    return source.problem(option, found, allowed, hint, at_name=at_name)


def _in_document(place: OptionPath, source: Source) -> OptionPath:
    """Return an error's place without the parts that stand for members of a union and are not in the document."""
    option: OptionPath = ()
    for part in place:
        if (*option, part) in source.marks:
            option = (*option, part)
    return option


def options_at(model: Any, place: OptionPath) -> tuple[str, ...]:
    """Return the names of all options that a document may have in the section at `place`, in their order.

    `place` is that of an error: its steps are options, list indices, and tags that chose a member of a union.
    """
    whole = _schema(model)
    sections = list(_members(whole, whole))
    for part in place:
        sections = [inner for outer in sections for step in _step(outer, part) for inner in _members(step, whole)]
    options = [option for section in sections for option in section.get("properties", {}).items()]
    # One that has one value only, which is its default, nobody needs to write.
    return tuple(dict.fromkeys(name for name, schema in options if not {"const", "default"} <= schema.keys()))


@cache
def _schema(model: type[Any]) -> dict[str, Any]:
    return reader(model).json_schema()


def _members(schema: dict[str, Any], whole: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the members of a union at any depth, or what is none by itself."""
    if "$ref" in schema:
        schema = whole["$defs"][schema["$ref"].rpartition("/")[2]]
    members = schema.get("anyOf") or schema.get("oneOf")
    if not members:
        yield schema
    for member in members or ():
        yield from _members(member, whole)


def _step(section: dict[str, Any], part: str | int) -> Iterator[dict[str, Any]]:
    """Yield the schemas that one step of an error's place leads to."""
    options = section.get("properties", {})
    if isinstance(part, int):
        yield section.get("items", {})
    elif part in options:
        yield options[part]
    elif any(part == option.get("const") for option in options.values()):
        yield section
    elif isinstance(section.get("additionalProperties"), dict):
        yield section["additionalProperties"]
