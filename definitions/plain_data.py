"""Dataclasses as plain data, the way JSON holds them, and read back exactly.

Reading converts nothing and fills nothing in: every field must be there with a value of its own type, and nothing
besides. What a process hands to another one arrives as it was, or is refused.
"""

from __future__ import annotations

import math
from dataclasses import asdict, fields, is_dataclass
from enum import Enum
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

T = TypeVar("T")

UNIONS = (Union, type(int | None))
"""A union has another origin as it was written: Optional[X], or X | None."""

EXACT_INTEGERS = 1 << 53
"""Every whole number up to this one is a floating-point number too."""

TEXTS = {bool: "true or false", int: "a whole number", float: "a finite number", str: "a text"}


class InexactError(ValueError):
    """Plain data that is not exactly what a class holds; `problems` has one text for each place."""

    def __init__(self, problems: list[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = problems


def plain(value: Any) -> Any:
    """Return a dataclass as dictionaries, lists and values; numbers that are not finite are None, as JSON has none."""
    return _plain(asdict(value))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def exact(kind: type[T], data: Any, *, unlimited: bool = False) -> T:
    """Return a dataclass from plain data.

    Its fields may hold bool, int, float, str, enumerations of whole numbers, literals, `X | None`, `tuple[X, ...]` and
    dataclasses of these. `unlimited`: null in a field that holds a number means infinity, as `plain` writes it.

    Raises:
        InexactError: fields are missing, unknown or of another type; with the place of each.

    """
    reader = _Reader(unlimited=unlimited)
    value: T = reader.read(kind, data, "")
    if reader.problems:
        raise InexactError(reader.problems)
    return value


class _Reader:
    """Reads one dataclass and collects every problem on the way."""

    def __init__(self, *, unlimited: bool) -> None:
        self.problems: list[str] = []
        self._unlimited = unlimited

    def read(self, kind: Any, data: Any, place: str) -> Any:
        """Return what `data` holds as `kind`; None where a problem was found."""
        origin, members = get_origin(kind), get_args(kind)
        if origin in UNIONS:
            (member,) = (one for one in members if one is not type(None))
            return None if data is None else self.read(member, data, place)
        if origin is tuple and isinstance(data, list):
            return tuple(self.read(members[0], one, f"{place}[{at}]") for at, one in enumerate(data))
        if is_dataclass(kind) and isinstance(data, dict):
            return self._fields(kind, data, f"{place}." if place else "")
        if data is None and kind is float and self._unlimited:
            return math.inf
        fits, allowed = _value_fits(kind, origin, members, data)
        if not fits:
            self.problems.append(f"{place or 'the whole'}: found {data!r:.60}; allowed is {allowed}")
            return None
        return data if origin is Literal else kind(data)

    def _fields(self, kind: Any, data: dict[str, Any], inside: str) -> Any:
        names = [one.name for one in fields(kind)]
        before = len(self.problems)
        self.problems += [f"{inside}{name} is missing" for name in names if name not in data]
        self.problems += [f"{inside}{name} is unknown" for name in data if name not in names]
        hints = get_type_hints(kind)
        values = {name: self.read(hints[name], data[name], f"{inside}{name}") for name in names if name in data}
        return kind(**values) if len(self.problems) == before else None


def _value_fits(kind: Any, origin: Any, members: tuple[Any, ...], data: Any) -> tuple[bool, str]:
    """Tell whether a value is of its type, and what is allowed there; nothing is taken for something like it."""
    found = type(data)
    if origin is Literal:
        fits = any(data == one and found is type(one) for one in members)
        return fits, " or ".join(map(repr, members))
    if origin is tuple or is_dataclass(kind):
        return False, "a list" if origin is tuple else f"the fields of {kind.__name__}"
    if issubclass(kind, Enum):
        allowed = [one.value for one in kind]
        return found is int and data in allowed, f"one of {allowed}"
    if kind is float:
        fits = math.isfinite(data) if found is float else found is int and abs(data) <= EXACT_INTEGERS
        return fits, TEXTS[float]
    return found is kind, TEXTS[kind]
