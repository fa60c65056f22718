"""Number formats of profile files and their ranges, for object dictionaries and registers alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import itemgetter
from types import MappingProxyType
from typing import Any, Literal

IntegerType = Literal["u8", "i8", "u16", "i16", "u32", "i32"]
RegisterType = Literal["u16", "i16", "u32", "i32", "f32"]

LETTERS = MappingProxyType({"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "f32": "f"})
"""`struct` letter of each type; byte order is the user's."""

SIZES = MappingProxyType({"u8": 1, "i8": 1, "u16": 2, "i16": 2, "u32": 4, "i32": 4, "f32": 4})
"""Bytes of each type."""

RANGES = MappingProxyType(
    {
        "u8": (0, 0xFF),
        "i8": (-0x80, 0x7F),
        "u16": (0, 0xFFFF),
        "i16": (-0x8000, 0x7FFF),
        "u32": (0, 0xFFFF_FFFF),
        "i32": (-0x8000_0000, 0x7FFF_FFFF),
    }
)
"""Smallest and largest value of each integer type."""


def to_integer(value: float, type_name: str) -> tuple[int, bool]:
    """Round `value` into the range of an integer type; the second result tells that it did not fit.

    A value that is not a number becomes 0 and does not fit: a set-point nobody computed must not move anything.
    """
    low, high = RANGES[type_name]
    if low <= value <= high:
        return round(value), False
    if value > high:
        return high, True
    if value < low:
        return low, True
    return 0, True


def picker(places: Sequence[int]) -> Callable[[Sequence[Any]], tuple[Any, ...]]:
    """Return a function that picks the values at these places: for the scan, without a loop of ours in it."""
    if len(places) > 1:
        return itemgetter(*places)
    return lambda values: tuple(values[place] for place in places)
