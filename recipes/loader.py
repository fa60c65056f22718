"""The strict loader: a YAML file and a pydantic model in, the model out, or all problems of the file at once."""

from __future__ import annotations

import types
import typing
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, ValidationError

from recipes.bench_schema import Bench
from recipes.problems import Problem, RecipeError, nearest
from recipes.quantity import QuantityError, parse
from recipes.recipe_schema import Recipe
from recipes.sequence_schema import STEP_KINDS, order_faults
from recipes.yaml_source import Path_, Source, read_source, show_path

ModelT = TypeVar("ModelT", bound=BaseModel)
ROOT: Path_ = ()


def load_document(path: str | Path, model: type[ModelT], context: Mapping[str, Any] | None = None) -> ModelT:
    """Load a YAML file into a pydantic model; raises `RecipeError` with every problem, each with its place."""
    source = read_source(path)
    return _validate(source, model, context)


def load_recipe(path: str | Path) -> Recipe:
    """Load a recipe; percentages of torque refer to its rated torque. Raises `RecipeError`."""
    source = read_source(path)
    source.problems += _order_problems(source)
    # without a rated torque, which is a problem of its own, percentages are only checked for their form
    return _validate(source, Recipe, {"rated_torque_nm": _rated_torque_nm(source.data) or 100.0})


def load_bench(path: str | Path) -> Bench:
    """Load a bench file by its path. Raises `RecipeError`."""
    return load_document(path, Bench)


def problem_at(source: Source, path: Path_, found: str, allowed: str, hint: str = "") -> Problem:
    """A problem at a value (or, when it is missing, at the nearest thing around it)."""
    line, column = _place(source, path)
    return Problem(source.path, line, column, show_path(path), found, allowed, hint)


def _validate(source: Source, model: type[ModelT], context: Mapping[str, Any] | None) -> ModelT:
    loaded: ModelT | None = None
    if not isinstance(source.data, dict):
        found = f"found {type(source.data).__name__} instead of sections"
        source.problems.append(problem_at(source, ROOT, found, f"sections {_names(model)}"))
    else:
        try:
            loaded = model.model_validate(source.data, context=dict(context) if context else None)
        except ValidationError as error:
            source.problems += [_translate(source, model, item) for item in error.errors(include_url=False)]
    if source.problems or loaded is None:
        raise RecipeError(source.problems)
    return loaded


def _rated_torque_nm(data: Any) -> float | None:
    try:
        return parse(data["unit_under_test"]["rated_torque"], "torque", above=0.0)
    except (KeyError, TypeError, QuantityError):
        return None


def _order_problems(source: Source) -> list[Problem]:
    steps = source.data.get("sequence") if isinstance(source.data, dict) else None
    if not isinstance(steps, list):
        return []
    kinds = [next(iter(step)) if isinstance(step, dict) and len(step) == 1 else "" for step in steps]
    return [
        problem_at(source, ("sequence",) if index is None else ("sequence", index), found, allowed)
        for index, found, allowed in order_faults(kinds)
    ]


def _place(source: Source, path: Path_) -> tuple[int, int]:
    while path:
        if path in source.places:
            return source.places[path]
        path = path[:-1]
    return source.places.get(ROOT, (1, 1))


def _translate(source: Source, model: type[BaseModel], item: Mapping[str, Any]) -> Problem:
    path, kind, context = _file_path(source, item["loc"]), str(item["type"]), item.get("ctx", {})
    error = context.get("error")
    if isinstance(error, QuantityError):
        return problem_at(source, path, error.found, error.allowed)
    if kind == "extra_forbidden":
        valid = _names_at(model, item["loc"][:-1])
        line, column = source.key_places.get(path, _place(source, path))
        found = f"the key '{path[-1]}' is not known here"
        return Problem(
            source.path, line, column, show_path(path), found, ", ".join(valid), nearest(str(path[-1]), valid)
        )
    if kind == "missing":
        return problem_at(source, path, "this key is missing", "a value for it")
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        return _unknown_step(source, path)
    found = f"found {_show(item.get('input'))}"
    allowed = _ALLOWED[kind](context) if kind in _ALLOWED else str(item["msg"])
    hint = nearest(str(item.get("input")), _literals(context)) if kind == "literal_error" else ""
    return problem_at(source, path, found, allowed, hint)


def _unknown_step(source: Source, path: Path_) -> Problem:
    value: Any = source.data
    for part in path:
        value = value[part]
    if isinstance(value, dict) and len(value) == 1:
        name = str(next(iter(value)))
        hint = nearest(name, STEP_KINDS)
        return problem_at(source, path, f"found the step '{name}', which is not known", ", ".join(STEP_KINDS), hint)
    example = "one step with its options, such as '- unload: {torque_rate: 100 N·m/s}'"
    return problem_at(source, path, f"found {_show(value)} instead of a step", example)


def _literals(context: Mapping[str, Any]) -> list[str]:
    return str(context.get("expected", "")).replace("'", "").replace(" or ", ", ").split(", ")


_ALLOWED: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "literal_error": lambda context: ", ".join(_literals(context)),
    "greater_than": lambda context: f"above {context['gt']}",
    "greater_than_equal": lambda context: f"{context['ge']} or more",
    "less_than": lambda context: f"below {context['lt']}",
    "less_than_equal": lambda context: f"{context['le']} or less",
    "int_type": lambda _: "a whole number",
    "float_type": lambda _: "a number",
    "string_type": lambda _: "a text",
    "bool_type": lambda _: "true or false",
    "model_type": lambda _: "a section with its own keys",
    "model_attributes_type": lambda _: "one step with its options, such as '- unload: {torque_rate: 100 N·m/s}'",
    "tuple_type": lambda _: "a list",
    "date_type": lambda _: "a date such as 2026-03-31",
    "finite_number": lambda _: "a finite number",
    "string_pattern_mismatch": lambda _: "letters, digits and . _ + - only, without blanks",
    "string_too_short": lambda _: "at least one character",
    "too_short": lambda _: "at least one entry",
}


def _file_path(source: Source, loc: tuple[str | int, ...]) -> Path_:
    """The path in the file: pydantic's location without the parts that are names of union members."""
    path: Path_ = ()
    for part in loc:
        longer = (*path, part)
        if longer in source.places or part == loc[-1]:
            path = longer
    return path


def _names(model: type[BaseModel]) -> str:
    return ", ".join(_keys(model))


def _keys(model: type[BaseModel]) -> list[str]:
    return [field.alias or name for name, field in model.model_fields.items() if name != "kind"]


def _names_at(model: type[BaseModel], loc: tuple[str | int, ...]) -> list[str]:
    """Keys that are valid at a location: walks the annotations of the models."""
    candidates: list[type[BaseModel]] = [model]
    for part in loc:
        if isinstance(part, int):
            continue
        tagged = [item for item in candidates if _tag(item) == part]
        if tagged:
            candidates = tagged
            continue
        candidates = [
            inner
            for item in candidates
            for name, field in item.model_fields.items()
            if part in (name, field.alias)
            for inner in _models(field.annotation)
        ]
    return sorted({key for item in candidates for key in _keys(item)})


def _tag(model: type[BaseModel]) -> str | None:
    field = model.model_fields.get("kind")
    if field is not None and typing.get_origin(field.annotation) is Literal:
        return str(typing.get_args(field.annotation)[0])
    return None


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        return [annotation] if issubclass(annotation, BaseModel) else []
    return [model for inner in typing.get_args(annotation) for model in _models(inner)]


def _show(value: Any) -> str:
    text = "nothing" if value is None else f"'{value}'" if isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
