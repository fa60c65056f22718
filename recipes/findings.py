"""What a validation error means to the person who wrote the file: found, allowed, what to do.

One row of `ALLOWED` per error type of pydantic that a document can cause; a type without a row is reported in
pydantic's own words.
"""

from __future__ import annotations

import re
from typing import Any

from pydantic import BaseModel

from recipes.option_names import options_at
from recipes.problems import Problem, did_you_mean, excerpt, one_of
from recipes.yaml_source import OptionPath, Source

WHOLE = "a whole number"
NUMBER = "a number"
TEXT = "a text"
LIST = "a list (lines that begin with '- ', or [..., ...])"
DATE = "a date such as 2025-03-31"

ALLOWED: dict[str, tuple[str, str]] = {
    "int_type": (WHOLE, ""),
    "int_from_float": (WHOLE, ""),
    "int_parsing": (WHOLE, ""),
    "int_parsing_size": (WHOLE, "This is too large."),
    "float_type": (NUMBER, "Write it without a unit."),
    "float_parsing": (NUMBER, "Write it without a unit."),
    "finite_number": (NUMBER, "Infinity is not a value."),
    "bool_type": ("true or false", ""),
    "bool_parsing": ("true or false", ""),
    "string_type": (TEXT, "Put it in quotes."),
    "string_too_short": ("a text of at least {min_length} characters", ""),
    "string_too_long": ("a text of at most {max_length} characters", "Make it shorter."),
    "greater_than": ("a number above {gt}", "This is too small."),
    "greater_than_equal": ("a number from {ge}", "This is too small."),
    "less_than": ("a number below {lt}", "This is too large."),
    "less_than_equal": ("a number up to {le}", "This is too large."),
    "multiple_of": ("a multiple of {multiple_of}", ""),
    "list_type": (LIST, ""),
    "tuple_type": (LIST, ""),
    "too_short": ("a list of at least {min_length} entries", "Add an entry."),
    "too_long": ("a list of at most {max_length} entries", "Shorten the list."),
    "date_type": (DATE, ""),
    "date_parsing": (DATE, ""),
    "date_from_datetime_parsing": (DATE, ""),
    "date_from_datetime_inexact": (DATE, "Write the day only."),
    "none_required": ("nothing", ""),
    "dict_type": ("a section (lines of name: value)", "Write its entries indented below its name."),
}

PATTERNS = {
    r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$": "a short name of letters, digits and . _ + - without spaces",
    r"^[A-Za-z0-9_.:-]+$": "a host name or address such as 192.168.0.10",
    r"^\S+$": "a path without spaces, such as /dev/ttyUSB0",
}
"""Patterns of `recipes.section` in words."""

SECTION_TYPES = ("model_type", "model_attributes_type", "dict_type")
CHOICE_TYPES = ("literal_error", "enum")


def problem_of(detail: dict[str, Any], source: Source, model: type[BaseModel]) -> Problem:
    """Return one of pydantic's error details as a problem with its place in the document."""
    place: OptionPath = tuple(detail["loc"])
    kind: str = detail["type"]
    context: dict[str, Any] = detail.get("ctx") or {}
    value = detail["input"]
    if kind == "refused":
        option = _in_document(place, source)
        if context["at"]:
            option = (*option, *(part for part in context["at"].split(".")))
        return source.problem(option, context["found"], context["allowed"], context["hint"])
    if kind == "missing":
        name = str(place[-1])
        option = (*_in_document(place[:-1], source), name)
        return source.problem(option, "nothing", f"the option '{name}', which is required", "Add it.", at_name=True)
    if kind == "extra_forbidden":
        return _unknown_option(place, source, model)
    option = _in_document(place, source)
    if kind in SECTION_TYPES and kind != "dict_type":
        names = options_at(model, place)
        allowed = f"a section with the options {one_of(names)}" if names else ALLOWED["dict_type"][0]
        return source.problem(option, excerpt(value), allowed, "Write its options indented below its name.")
    if kind in CHOICE_TYPES:
        choices = re.findall(r"'([^']*)'", context["expected"]) or [context["expected"]]
        return source.problem(option, excerpt(value), one_of(choices), _meant(value, choices))
    if kind == "union_tag_invalid":
        choices = re.findall(r"'([^']*)'", context["expected_tags"])
        tag_option = (*option, str(context["discriminator"]).strip("'"))
        tag_option = tag_option if tag_option in source.marks else option
        return source.problem(tag_option, excerpt(context["tag"]), one_of(choices), _meant(context["tag"], choices))
    if kind == "string_pattern_mismatch":
        allowed = PATTERNS.get(context["pattern"], f"a text of the form {context['pattern']}")
        return source.problem(option, excerpt(value), allowed)
    if kind in ALLOWED:
        allowed, hint = ALLOWED[kind]
        return source.problem(option, excerpt(value), allowed.format(**context), hint)
    return source.problem(option, excerpt(value), detail["msg"].removeprefix("Value error, "))


def _unknown_option(place: OptionPath, source: Source, model: type[BaseModel]) -> Problem:
    name = str(place[-1])
    names = options_at(model, place[:-1])
    option = (*_in_document(place[:-1], source), name)
    hint = did_you_mean(name, names) or "Delete it."
    allowed = one_of(names) if names else "no options"
    return source.problem(option, f"the unknown option {excerpt(name)}", allowed, hint, at_name=True)


def _meant(value: object, choices: list[str]) -> str:
    return did_you_mean(value, choices) if isinstance(value, str) else ""


def _in_document(place: OptionPath, source: Source) -> OptionPath:
    """Return an error's place without the parts that stand for members of a union and are not in the document."""
    option: OptionPath = ()
    for part in place:
        if (*option, part) in source.marks:
            option = (*option, part)
    return option
