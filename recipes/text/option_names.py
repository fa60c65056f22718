"""Which options a model knows at a place: for the nearest valid name of a mistyped one.

Walks the annotations of any pydantic model, those of other packages included.
"""

from __future__ import annotations

import types
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from recipes.text.document import OptionPath


def options_at(model: type[BaseModel], place: OptionPath) -> tuple[str, ...]:
    """Return the names of all options that a document may have in the section at `place`, in their order."""
    annotations: list[Any] = [model]
    for part in place:
        annotations = [inner for outer in annotations for inner in _step(outer, part)]
    names: dict[str, None] = {}
    for annotation in annotations:
        for known in _models(annotation):
            options = (pair for pair in known.model_fields.items() if not _is_constant(pair[1]))
            names.update(dict.fromkeys(_written_name(name, field) for name, field in options))
    return tuple(names)


def _is_constant(field: FieldInfo) -> bool:
    """Say whether an option has one value only, which is its default: nobody needs to write it."""
    return get_origin(field.annotation) is Literal and get_args(field.annotation) == (field.default,)


def _written_name(name: str, field: FieldInfo) -> str:
    alias = field.validation_alias if isinstance(field.validation_alias, str) else field.alias
    return alias or name


def _step(annotation: Any, part: str | int) -> Iterable[Any]:
    """Yield the annotations that one step of an error's place leads to.

    A step is a list index, an option, or the tag that chose one member of a union.
    """
    for plain in _alternatives(annotation):
        origin = get_origin(plain)
        if isinstance(part, int):
            yield from _entries(origin, get_args(plain), part)
        elif origin in (dict, types.MappingProxyType):
            yield get_args(plain)[1]
        elif isinstance(plain, type) and issubclass(plain, BaseModel):
            if part in _tags(plain):
                yield plain
            for name, field in plain.model_fields.items():
                if part in (name, _written_name(name, field)):
                    yield field.annotation


def _entries(origin: Any, arguments: Sequence[Any], index: int) -> Iterable[Any]:
    if origin is tuple and arguments and arguments[-1] is not Ellipsis:
        yield from arguments[index : index + 1]
    elif origin in (tuple, list, set, frozenset) and arguments:
        yield arguments[0]


def _alternatives(annotation: Any) -> Iterable[Any]:
    """Yield the members of a union, at any depth of `Annotated`, `Union` and type aliases."""
    origin = get_origin(annotation)
    if origin is Annotated:
        yield from _alternatives(get_args(annotation)[0])
    elif origin in (Union, types.UnionType):
        for member in get_args(annotation):
            yield from _alternatives(member)
    else:
        yield annotation


def _models(annotation: Any) -> Iterable[type[BaseModel]]:
    for plain in _alternatives(annotation):
        if isinstance(plain, type) and issubclass(plain, BaseModel):
            yield plain


def _tags(model: type[BaseModel]) -> set[str]:
    """Return the texts of a model's literal options: one of them may be the tag that chose it in a union."""
    tags: set[str] = set()
    for field in model.model_fields.values():
        if get_origin(field.annotation) is Literal:
            tags.update(str(value) for value in get_args(field.annotation))
    return tags
