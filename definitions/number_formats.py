"""Number formats: of object dictionaries and registers by their names in profile files, and of records."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Literal

IntegerType = Literal["u8", "i8", "u16", "i16", "u32", "i32"]
RegisterType = Literal["u16", "i16", "u32", "i32", "f32"]

FieldType = Literal["u16", "i16", "u32", "i32", "f32", "bit"]
"""Types of values that a Modbus device has: of its registers, and of its coils and discrete inputs."""

ByteType = Literal["u8", "i8", "u16", "i16", "u32", "i32", "f32"]
"""Types of values that begin at a byte of a CAN frame."""

BIT = "bit"
"""Type of a coil or discrete input."""

IGNORED = "ignored"
"""Name in profile files of a mapped object whose number nobody looks at."""

LETTERS: Mapping[str, str] = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "f32": "f"}
"""`struct` letter of each type; byte order is the user's."""

SIZES: Mapping[str, int] = {"u8": 1, "i8": 1, "u16": 2, "i16": 2, "u32": 4, "i32": 4, "f32": 4}
"""Bytes of each type."""

RANGES: Mapping[str, tuple[int, int]] = {
    "u8": (0, 0xFF),
    "i8": (-0x80, 0x7F),
    "u16": (0, 0xFFFF),
    "i16": (-0x8000, 0x7FFF),
    "u32": (0, 0xFFFF_FFFF),
    "i32": (-0x8000_0000, 0x7FFF_FFFF),
}
"""Smallest and largest value of each integer type."""

LARGEST_COUNT, LARGEST = (1 << 31) - 1, (1 << 63) - 1
"""Largest count and largest other whole number of a record: what the integers of a database hold."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Annotation of what a number, or the length of a list or text, may be; checked where a file is read.

    The names are those of pydantic, which asks an annotation for its hook: nothing has to be imported for that.
    """

    ge: float | None = None
    gt: float | None = None
    le: float | None = None
    lt: float | None = None
    min_length: int | None = None
    max_length: int | None = None
    pattern: str | None = None

    def __get_pydantic_core_schema__(self, source: object, handler: Callable[[object], dict[str, object]]) -> object:
        stated = {one.name: getattr(self, one.name) for one in fields(self)}
        return handler(source) | {name: limit for name, limit in stated.items() if limit is not None}


def check_range(value: int, type_name: IntegerType, where: str) -> None:
    """Raise ValueError, which names `where`, when a value is beyond its type."""
    low, high = RANGES[type_name]
    if not low <= value <= high:
        raise ValueError(f"{where}: found {value}; a number of type {type_name} must be from {low} to {high}")
