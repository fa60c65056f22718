"""The strict loader: a YAML document into a frozen model, or all of its problems at once.

Every problem has its line and column, the option, what was found, what is allowed and what to do. `RecipeError` is the
only exception that leaves this module, whatever the file holds.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from recipes.text.problems import OptionPath, Problem, RecipeError, Source, dotted, nearest, one_of
from recipes.text.quantity import ONE_POINT, meant_by
from recipes.text.section import FROM_DOCUMENT, reader
from recipes.text.translation import UNKNOWN_OPTION, decimal_commas, options_at, problem_of
from recipes.text.yaml_source import parse_source, read_bytes, refuse_misleading

ModelT = TypeVar("ModelT")
Context = Mapping[str, Any] | Callable[[Any], Mapping[str, Any]]
"""Validation context, or a function that makes it from the document's plain data."""
Rule = Callable[[Source], Iterable[Problem]]
"""Check of a document's plain data, made whether or not its sections are in order."""


def load_document(path: str | Path, model: type[ModelT], context: Context | None = None) -> ModelT:
    """Load a YAML document as a model. Raises RecipeError with all problems of the document, sorted by line.

    An option with nothing behind it is one, where the model takes it: its author meant to add a value.
    """
    raw = read_bytes(path)
    refuse_misleading(raw, str(path))
    source = parse_source(raw, str(path))
    loaded = load_source(source, model, context)
    source.refuse_empty_options()
    return loaded


def parse_document(raw: bytes, path: str, model: type[ModelT], context: Context | None = None) -> ModelT:
    """Load a document from the bytes of a file that was already read. Raises RecipeError."""
    return load_source(parse_source(raw, path), model, context)


def load_source(
    source: Source, model: type[ModelT], context: Context | None = None, rules: Iterable[Rule] = ()
) -> ModelT:
    """Load a document that was already read; `rules` add their problems to those of the model.

    Raises RecipeError.
    """
    if not source.complete:
        raise RecipeError(source.problems)
    problems = list(source.problems)
    values = context(source.data) if callable(context) else context or {}
    for rule in rules:
        problems.extend(rule(source))
    loaded: ModelT | None = None
    try:
        # JSON mode is what YAML is: lists become tuples and texts become dates or enumerations, and nothing else is
        # converted. By alias only: an attribute's name with its unit is not an option.
        loaded = reader(model).validate_json(
            json.dumps(source.data), strict=True, context={FROM_DOCUMENT: True, **values}, by_alias=True, by_name=False
        )
    except ValidationError as error:
        details = error.errors(include_url=False)
        found = (problem_of(detail, source, model) for detail in _without_echoes(details, model))
        problems.extend(_with_commas_told(list(found), source))
    if loaded is None or problems:
        raise RecipeError(problems)
    return loaded


def _with_commas_told(found: list[Problem], source: Source) -> list[Problem]:
    """Tell a decimal comma once, with the number as it stands there, in the place of what YAML makes of its halves."""
    commas = list(decimal_commas(source))
    halves = {dotted(option) for whole, rest, _ in commas for option in (whole, rest)}
    told = []
    for whole, _, text in commas:
        meant, hint = meant_by(text)
        allowed = one_of([f"'{one}'" for one in meant]) or "a number with one decimal sign"
        told.append(source.problem(whole, f"'{text}', with a comma", allowed, hint or ONE_POINT))
    return [*(one for one in found if one.option not in halves), *told]


def _without_echoes(details: list[ErrorDetails], model: type[object]) -> list[ErrorDetails]:
    """Leave out every missing option that stands there under a mistyped name: one mistake, one message."""
    mistyped: set[OptionPath] = set()
    for detail in details:
        if detail["type"] in UNKNOWN_OPTION:
            *section, name = detail["loc"]
            meant = nearest(str(name), options_at(model, tuple(section)))
            if meant:
                mistyped.add((*section, meant))
    return [detail for detail in details if detail["type"] != "missing" or detail["loc"] not in mistyped]
