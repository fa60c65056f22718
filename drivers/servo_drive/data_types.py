"""Numbers on their way to the wire: rounded into an integer type, picked out of what was unpacked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any

from definitions.number_formats import RANGES


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
