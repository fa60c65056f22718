"""Holds plain data against a JSON Schema, as far as those of this project go; a word it does not know is an error."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

SAID_ONLY = {"$schema", "$defs", "title", "description", "default"}
TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "integer": (int,),
    "number": (int, float),
    "boolean": (bool,),
    "null": (type(None),),
}


def differences(value: Any, schema: dict[str, Any], root: dict[str, Any], place: str = "$") -> Iterator[str]:
    """Yield where a value is not what its schema allows."""
    for word, said in schema.items():
        if word in SAID_ONLY:
            continue
        yield from RULES[word](value, said, schema, root, place)  # KeyError: a word that nobody checks


def _ref(value: Any, said: str, _: dict[str, Any], root: dict[str, Any], place: str) -> Iterator[str]:
    yield from differences(value, root["$defs"][said.removeprefix("#/$defs/")], root, place)


def _type(value: Any, said: str, _: dict[str, Any], __: dict[str, Any], place: str) -> Iterator[str]:
    if not isinstance(value, TYPES[said]) or (isinstance(value, bool) and said != "boolean"):
        yield f"{place}: found {value!r:.40}; allowed is {said}"


def _any_of(value: Any, said: list[Any], _: dict[str, Any], root: dict[str, Any], place: str) -> Iterator[str]:
    found = [list(differences(value, one, root, place)) for one in said]
    if all(found):
        yield from min(found, key=len)


def _properties(value: Any, said: dict[str, Any], _: dict[str, Any], root: dict[str, Any], place: str) -> Iterator[str]:
    if isinstance(value, dict):
        for name in value.keys() & said.keys():
            yield from differences(value[name], said[name], root, f"{place}.{name}")


def _more(value: Any, said: Any, schema: dict[str, Any], root: dict[str, Any], place: str) -> Iterator[str]:
    for name in value.keys() - schema.get("properties", {}).keys() if isinstance(value, dict) else ():
        yield from differences(value[name], said, root, f"{place}.{name}")


def _required(value: Any, said: list[str], _: dict[str, Any], __: dict[str, Any], place: str) -> Iterator[str]:
    if isinstance(value, dict):
        yield from (f"{place}.{name}: is missing" for name in said if name not in value)


def _items(value: Any, said: Any, schema: dict[str, Any], root: dict[str, Any], place: str) -> Iterator[str]:
    for number, one in enumerate(value if isinstance(value, list) else ()):
        if number >= len(schema.get("prefixItems", ())):
            yield from differences(one, said, root, f"{place}[{number}]")


def _prefix(value: Any, said: list[Any], _: dict[str, Any], root: dict[str, Any], place: str) -> Iterator[str]:
    for number, (one, allowed) in enumerate(zip(value, said, strict=False) if isinstance(value, list) else ()):
        yield from differences(one, allowed, root, f"{place}[{number}]")


def _names(value: Any, said: Any, _: dict[str, Any], root: dict[str, Any], place: str) -> Iterator[str]:
    for name in value if isinstance(value, dict) else ():
        yield from differences(name, said, root, f"{place} name")


def _pattern(value: Any, said: str, _: dict[str, Any], __: dict[str, Any], place: str) -> Iterator[str]:
    if isinstance(value, str) and not re.search(said, value):
        yield f"{place}: found {value!r:.40}; allowed is {said}"


def _least(value: Any, said: float, _: dict[str, Any], __: dict[str, Any], place: str) -> Iterator[str]:
    size = len(value) if isinstance(value, list) else value
    if isinstance(size, int | float) and size < said:
        yield f"{place}: found {size}; allowed is at least {said}"


def _most(value: Any, said: float, _: dict[str, Any], __: dict[str, Any], place: str) -> Iterator[str]:
    size = len(value) if isinstance(value, list) else value
    if isinstance(size, int | float) and size > said:
        yield f"{place}: found {size}; allowed is at most {said}"


RULES = {
    "$ref": _ref,
    "type": _type,
    "anyOf": _any_of,
    "properties": _properties,
    "additionalProperties": _more,
    "propertyNames": _names,
    "required": _required,
    "items": _items,
    "prefixItems": _prefix,
    "pattern": _pattern,
    "minimum": _least,
    "maximum": _most,
    "minItems": _least,
    "maxItems": _most,
}
