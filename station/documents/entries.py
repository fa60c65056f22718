"""What documents are made of: kinds of entries, what is allowed in them, and how they are written as plain data.

What is written has the entries of the class in their order; one that is `left_out` has none while there is nothing to
say. A process that scans writes documents and reads none: nothing here brings the reader and its library along.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from typing import Annotated, Any

from definitions.number_formats import LARGEST_COUNT
from station.documents.signs import in_signs

LEFT_OUT = "left out"
ALONGSIDE = "alongside"

Number = int | float
"""A figure as it stands in JSON: a whole number stays one."""

Plain = dict[str, Any]
"""An object of JSON: what its entries are is known where it is read into a class, and not before."""


@dataclass(frozen=True)
class Mark:
    """What is allowed in an entry: `limits` for the reader, by the names it has for them, and in words.

    The reader asks it by the two methods whose names are its library's.
    """

    limits: tuple[tuple[str, int | str], ...]
    words: str

    def __get_pydantic_core_schema__(self, kind: Any, handler: Callable[[Any], Plain]) -> Plain:
        """Return how the reader reads such an entry."""
        return {**handler(kind), **dict(self.limits)}

    def __get_pydantic_json_schema__(self, schema: Any, handler: Callable[[Any], Plain]) -> Plain:
        """Return what the published schema says of it."""
        return {**handler(schema), "description": self.words}


def one_of(*allowed: str) -> Mark:
    """Return the mark of a text that is one of these."""
    return Mark((("pattern", f"^({'|'.join(allowed)})$"),), f"one of {', '.join(allowed)}")


def whole_number(least: int, most: int) -> Mark:
    """Return the mark of a whole number from the least to the most."""
    return Mark((("ge", least), ("le", most)), f"a whole number from {least} to {most}")


Count = Annotated[int, whole_number(0, LARGEST_COUNT)]


def left_out(*, when: Any = None) -> Any:
    """Return the field of an entry that is not written while it is None; its default is that."""
    return field(default=when, metadata={LEFT_OUT: True})


def alongside() -> Any:
    """Return the field of a part that is no entry itself: its own entries, if it is there, stand among the others."""
    return field(metadata={ALONGSIDE: True})


def plain(document: object) -> Any:
    """Return a document, or what stands in one, as the plain data that JSON is made of; texts are in signs."""
    if is_dataclass(document) and not isinstance(document, type):
        written: Plain = {}
        for name, optional, among in _written(type(document)):
            value = getattr(document, name)
            if among:
                written |= plain(value) or {}
            elif not (optional and value is None):
                written[name] = plain(value)
        return written
    if hasattr(document, "_asdict"):
        return plain(document._asdict())
    if isinstance(document, Mapping):
        return {key: plain(value) for key, value in document.items()}
    if isinstance(document, list | tuple):
        return [plain(value) for value in document]
    return in_signs(document) if isinstance(document, str) else document


@cache
def _written(kind: Any) -> tuple[tuple[str, bool, bool], ...]:
    return tuple((one.name, LEFT_OUT in one.metadata, ALONGSIDE in one.metadata) for one in fields(kind))
