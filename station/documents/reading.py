"""Reading of documents: one way from JSON to a class, for every class of this room; `entries` does the reverse.

A reader gets a document in which every entry is of its kind, or a RecordError that names the file, the entry, what was
found and what is allowed. What an older version did not write has the default of its class. An entry that no class
knows is passed over. What a terminal would obey stands in the texts in signs.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from itertools import zip_longest
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from station.atomic_file import document_bytes, open_file, refused
from station.documents.entries import Mark
from station.documents.signs import all_in_signs, in_signs, may_hold_obeyed
from station.errors import RecordError

NEXT_STEP = "Restore the file from a backup, or move the run's folder out of the data folder"
LONGEST_SHOWN = 40

NUL = rb"\u0000"
"""How the character U+0000 stands in JSON: no text of this program has it, and not every database can hold it."""

Document = TypeVar("Document")

_WORDS: dict[Any, str] = {
    str: "a text",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    object: "any value",
}


def read_document(kind: type[Document], path: Path) -> Document:
    """Return the document in a file.

    Raises:
        RecordError: it cannot be read, is no JSON, or an entry is missing or of another kind.

    """
    try:
        with open_file(path) as file:
            content = document_bytes(file)
    except OSError as error:
        raise refused(path, error, "read") from error
    return document_in(kind, content, path)


def document_in(kind: type[Document], content: bytes, place: Path) -> Document:
    """Return the document in these bytes; `place` is named in the RecordError of one that is damaged."""
    try:
        found = adapter(kind).validate_json(content, strict=True)
    except ValidationError as error:
        raise RecordError(f"{place}: is damaged: {'; '.join(_wrong(kind, error))}. {NEXT_STEP}") from error
    if not may_hold_obeyed(content):
        return found
    stored = json.loads(content)
    if NUL in content and (entries := list(_with_nul(stored))):
        said = f"found {_shown(entries[0][1])}; allowed is a text without the character U+0000"
        raise RecordError(f"{place}: is damaged: {entries[0][0]}: {said}. {NEXT_STEP}")
    shown = all_in_signs(stored)
    return found if shown == stored else document_in(kind, json.dumps(shown, ensure_ascii=False).encode(), place)


def whole_lines(kind: type[Document], path: Path) -> Iterator[Document]:
    """Yield the documents of a file that has one in each line; none where there is no file.

    A line that is torn or of another kind is passed over: whoever appends to such a file writes anew what is missing.

    Raises:
        RecordError: the file cannot be read.

    """
    try:
        with open_file(path) as file:
            content = document_bytes(file)
    except FileNotFoundError:
        return
    except OSError as error:
        raise refused(path, error, "read") from error
    for row in content.split(b"\n"):
        try:
            yield document_in(kind, row, path)
        except RecordError:
            continue


def of_plain(kind: type[Document], found: object, place: Path) -> Document:
    """Return plain data of this program as a document; RecordError as `document_in`."""
    return document_in(kind, json.dumps(found, ensure_ascii=False).encode(), place)


_ADAPTERS: dict[type, TypeAdapter[Any]] = {}


def adapter(kind: type[Document]) -> TypeAdapter[Document]:
    """Return what reads a class and describes it; made at its first use, for it takes some milliseconds."""
    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
    return _ADAPTERS[kind]


def _with_nul(found: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """Yield the place of each text with the character U+0000, and the text; of a name, where it stands."""
    if isinstance(found, str):
        if "\0" in found:
            yield place, found
    elif isinstance(found, list):
        for number, one in enumerate(found):
            yield from _with_nul(one, f"{place}[{number}]")
    elif isinstance(found, dict):
        for name, one in found.items():
            yield from _with_nul(name, place or "the name of an entry")
            yield from _with_nul(one, f"{place}.{name}".removeprefix("."))


def _wrong(kind: type, error: ValidationError) -> list[str]:
    """Return what is wrong with each entry, once for each place."""
    said: dict[str, str] = {}
    for one in error.errors(include_url=False):
        if one["type"] == "json_invalid":
            return [f"it is not JSON ({one['msg'].removeprefix('Invalid JSON: ')})"]
        place, allowed = _place(kind, one["loc"])
        found = "is missing" if one["type"] == "missing" else f"found {_shown(one['input'])}"
        said.setdefault(place, f"{place}: {found}; allowed is {_words(allowed)}".removeprefix(": "))
    return list(said.values())


def _place(kind: Any, steps: tuple[int | str, ...]) -> tuple[str, Any]:
    """Return the place of an entry as a person reads it, and the kind that is allowed there."""
    place = ""
    for step, behind in zip_longest(steps, steps[1:]):
        if behind == "[key]":  # the name of an entry itself is wrong
            return place, get_args(_members(kind)[0])[0]
        inner = _inside(kind, step)
        if inner is None:
            break  # the rest names members of a union
        kind, place = inner, f"{place}[{step}]" if isinstance(step, int) else f"{place}.{step}".removeprefix(".")
    return place, kind


def _inside(kind: Any, step: int | str) -> Any:
    """Return the kind of an entry within this one; None where there is none of that name."""
    for one in _members(kind):
        if is_dataclass(one):
            return get_type_hints(one, include_extras=True).get(str(step))
        origin, parts = get_origin(one), get_args(one)
        if origin is tuple and isinstance(step, int):
            return parts[0]
        if isinstance(origin, type) and issubclass(origin, Mapping):
            return parts[1]
    return None


def _members(kind: Any) -> list[Any]:
    """Return the kinds that a kind is made of, without None and without marks."""
    if get_origin(kind) is Annotated:
        return _members(get_args(kind)[0])
    if isinstance(kind, UnionType) or get_origin(kind) is Union:
        return [member for part in get_args(kind) for member in _members(part)]
    return [] if kind is NoneType else [kind]


def _words(kind: Any) -> str:
    """Return what is allowed at a place."""
    if get_origin(kind) is Annotated:
        said = [mark.words for mark in get_args(kind)[1:] if isinstance(mark, Mark)]
        said += [mark.description for mark in get_args(kind)[1:] if isinstance(mark, FieldInfo) and mark.description]
        return said[0] if said else _words(get_args(kind)[0])
    if isinstance(kind, UnionType) or get_origin(kind) is Union:
        parts = list(dict.fromkeys(_words(part) for part in get_args(kind) if part is not NoneType))
        words = "a number" if parts == ["a whole number", "a number"] else " or ".join(parts)
        return f"{words}, or null" if NoneType in get_args(kind) else words
    if get_origin(kind) is tuple:
        return "a list of texts" if get_args(kind)[0] is str else "a list"
    return _WORDS.get(kind, "a block of entries")


def _shown(value: Any) -> str:
    text = in_signs(json.dumps(value, ensure_ascii=False, default=str))
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
