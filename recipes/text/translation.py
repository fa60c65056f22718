"""What a validation error means to the person who wrote the file: found, allowed, what to do.

One row of `ALLOWED` per error type of pydantic that a document can cause; a type without a row is reported in
pydantic's own words.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from recipes.text.document import OptionPath, Source
from recipes.text.option_names import options_at
from recipes.text.problems import Problem, did_you_mean, excerpt, one_of

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
    "greater_than": ("a number above {gt:g}", "This is too small."),
    "greater_than_equal": ("a number from {ge:g}", "This is too small."),
    "less_than": ("a number below {lt:g}", "This is too large."),
    "less_than_equal": ("a number up to {le:g}", "This is too large."),
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
"""Patterns of `recipes.text.section` in words."""

QUOTED = re.compile(r"'([^']*)'")


@dataclass(frozen=True)
class Detail:
    """One of pydantic's error details, beside the document and the model that it is about."""

    source: Source
    model: type[BaseModel]
    place: OptionPath
    type: str
    value: object
    message: str
    context: dict[str, Any]

    @property
    def option(self) -> OptionPath:
        """Place in the document."""
        return _in_document(self.place, self.source)


def problem_of(error: Mapping[str, Any], source: Source, model: type[BaseModel]) -> Problem:
    """Return one of pydantic's error details as a problem with its place in the document."""
    place, kind, context = tuple(error["loc"]), error["type"], error.get("ctx") or {}
    detail = Detail(source, model, place, kind, error["input"], error["msg"], context)
    return TRANSLATORS.get(kind, _by_table)(detail)


def _refused(detail: Detail) -> Problem:
    context = detail.context
    parts = context["at"].split(".") if context["at"] else ()
    inside = tuple(int(part) if part.isdigit() else part for part in parts)
    option = (*detail.option, *inside)
    return detail.source.problem(option, context["found"], context["allowed"], context["hint"])


def _missing(detail: Detail) -> Problem:
    name = str(detail.place[-1])
    option = (*_in_document(detail.place[:-1], detail.source), name)
    allowed = f"the option '{name}', which is required"
    return detail.source.problem(option, "nothing", allowed, "Add it.", at_name=True)


def _unknown_option(detail: Detail) -> Problem:
    name = str(detail.place[-1])
    names = options_at(detail.model, detail.place[:-1])
    option = (*_in_document(detail.place[:-1], detail.source), name)
    hint = did_you_mean(name, names) or "Delete it."
    allowed = one_of(names) if names else "no options"
    return detail.source.problem(option, f"the unknown option {excerpt(name)}", allowed, hint, at_name=True)


def _no_section(detail: Detail) -> Problem:
    names = options_at(detail.model, detail.place)
    allowed = f"a section with the options {one_of(names)}" if names else "a section (lines of name: value)"
    hint = "Write its options indented below its name." if detail.place else "Copy a shipped file and edit it."
    return detail.source.problem(detail.option, excerpt(detail.value), allowed, hint)


def _no_choice(detail: Detail) -> Problem:
    choices = QUOTED.findall(detail.context["expected"]) or [str(detail.context["expected"])]
    return detail.source.problem(detail.option, excerpt(detail.value), one_of(choices), _meant(detail.value, choices))


def _no_member(detail: Detail) -> Problem:
    choices = QUOTED.findall(detail.context["expected_tags"])
    tag = detail.context["tag"]
    option = (*detail.option, str(detail.context["discriminator"]).strip("'"))
    return detail.source.problem(option, excerpt(tag), one_of(choices), _meant(tag, choices))


def _no_tag(detail: Detail) -> Problem:
    name = str(detail.context["discriminator"]).strip("'")
    return detail.source.problem(detail.option, f"no option '{name}'", f"an option '{name}'", "Add it.")


def _no_match(detail: Detail) -> Problem:
    pattern = detail.context["pattern"]
    allowed = PATTERNS.get(pattern, f"a text of the form {pattern}")
    return detail.source.problem(detail.option, excerpt(detail.value), allowed)


def _by_table(detail: Detail) -> Problem:
    allowed, hint = ALLOWED.get(detail.type, (detail.message.removeprefix("Value error, "), ""))
    if detail.type in ALLOWED:
        allowed = allowed.format(**detail.context)
    return detail.source.problem(detail.option, excerpt(detail.value), allowed, hint)


TRANSLATORS: dict[str, Callable[[Detail], Problem]] = {
    "refused": _refused,
    "missing": _missing,
    "extra_forbidden": _unknown_option,
    "model_type": _no_section,
    "model_attributes_type": _no_section,
    "literal_error": _no_choice,
    "enum": _no_choice,
    "union_tag_invalid": _no_member,
    "union_tag_not_found": _no_tag,
    "string_pattern_mismatch": _no_match,
}
"""Error types that need more than a row of `ALLOWED`."""


def _meant(value: object, choices: list[str]) -> str:
    return did_you_mean(value, choices) if isinstance(value, str) else ""


def _in_document(place: OptionPath, source: Source) -> OptionPath:
    """Return an error's place without the parts that stand for members of a union and are not in the document."""
    option: OptionPath = ()
    for part in place:
        if (*option, part) in source.marks:
            option = (*option, part)
    return option
