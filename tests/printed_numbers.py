"""Numbers in texts compared as numbers: another processor or library may move the last bit, and with it a last digit.

A figure that is computed again must be within half a unit of the last digit that was printed; two printings of the same
figure may differ by one such unit.
"""

from __future__ import annotations

import math
import re
from decimal import Decimal
from typing import Any

NUMBER = r"[-−+]?\d+(?:\.\d+)?(?:e[-−+]?\d+)?"
BEYOND_ROUNDING = 1e-6
"""Share of a unit of the last digit, for the bits that two ways of computing leave different."""


def number_of(text: str) -> float:
    """Return the number that a text prints."""
    return float(text.replace("−", "-"))


def last_digit(text: str) -> float:
    """Return what one unit of the last printed digit stands for."""
    exponent = Decimal(text.replace("−", "-")).as_tuple().exponent
    assert isinstance(exponent, int), f"{text} is no number"
    return float(10.0**exponent)


def prints(text: str, value: float) -> bool:
    """Whether a text prints a value, rounded to its last digit."""
    return abs(number_of(text) - value) <= (0.5 + BEYOND_ROUNDING) * last_digit(text)


def reads(text: str, expected: str) -> bool:
    """Whether `expected` stands in a text: words as they are, each number with a point as a number of those digits."""
    pieces = re.split(rf"({NUMBER})", expected)
    numbers = [piece for piece in pieces[1::2] if "." in piece]
    pattern = "".join(f"({NUMBER})" if n % 2 and "." in piece else re.escape(piece) for n, piece in enumerate(pieces))
    return any(
        all(_same(found, wanted) for found, wanted in zip(match.groups(), numbers, strict=True))
        for match in re.finditer(rf"(?=(?<![\d.]){pattern}(?!\d|\.\d))", text)
    )


def _same(found: str, wanted: str) -> bool:
    unit = last_digit(wanted)
    same_digits = abs(last_digit(found) - unit) <= BEYOND_ROUNDING * unit
    return same_digits and abs(number_of(found) - number_of(wanted)) <= (1.0 + BEYOND_ROUNDING) * unit


def alike(found: Any, expected: Any) -> bool:
    """Whether two pieces of plain data are the same: numbers with a point to nine digits, everything else exactly."""
    if isinstance(found, float) and isinstance(expected, float):
        return math.isclose(found, expected, rel_tol=1e-9, abs_tol=1e-12)
    if isinstance(found, dict) and isinstance(expected, dict):
        return list(found) == list(expected) and all(alike(found[key], expected[key]) for key in found)
    if isinstance(found, list) and isinstance(expected, list):
        return len(found) == len(expected) and all(map(alike, found, expected))
    return type(found) is type(expected) and bool(found == expected)
