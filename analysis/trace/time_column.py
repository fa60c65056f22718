"""The column of time in a file of another bench: which clock it counts by, and whether it tells the samples apart.

A recorder may write the time of its computer, which is UNIX time: seconds since 1970. Only differences of time say
anything of a loop, so that such a column is counted from its first row, where that takes nothing from its resolution.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from analysis.trace.errors import TableError
from analysis.trace.units import FloatArray

TIME = "t_s"

UNIX_FROM, UNIX_TO = 1.0e9, 2.0**32
"""Seconds since 1970 of the years 2001 to 2106; a recording that counts from its own begin never comes to 31 years."""

PARTS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}
"""Other counts of UNIX time: counts of one second, and their name."""

Fail = Callable[[int, str, str, str, str], TableError]
"""Makes the error for a row (from 1), a column, what was found, what is expected, and a hint."""

SECONDS = "seconds (t_s)"
FROM_FIRST = "subtract the time of the first row before the export, and write the difference in seconds"

COARSE_S = 0.01
"""Time that is rounded to this and shared by most rows is refused: a lag of that size changes the width of a loop."""

EXACT = 1e-3
"""Part of a step by which the difference of two rounded times may miss it, for they are not whole in binary."""


class Time(NamedTuple):
    """The column in seconds, and in words how it was read; '' as it stands."""

    seconds: FloatArray
    reading: str


def read_time(values: FloatArray, fail: Fail) -> Time:
    """Return the column of time [s], from its first row on where it is UNIX time in seconds.

    values: finite, one for each row. Raises what `fail` makes for UNIX time in other units than seconds, or with so few
    digits as single precision keeps: by it one time is told from the next every 128 s; and for time that is rounded so
    that most rows have that of the row before.
    """
    first = float(values[0]) if values.size else 0.0
    for counts, name in PARTS.items():
        if UNIX_FROM * counts <= first < UNIX_TO * counts:
            found = f"{first:.0f}, which is UNIX time in {name} (since 1970)"
            raise fail(1, TIME, found, SECONDS, FROM_FIRST)
    if first < UNIX_FROM or values.min() < UNIX_FROM or values.max() >= UNIX_TO:
        _refuse_coarse(values, fail)
        return Time(values, "")
    if np.array_equal(values.astype(np.float32).astype(np.float64), values):
        found = f"{first:.0f}, which is UNIX time (since 1970) with too few digits to tell the samples apart"
        raise fail(1, TIME, found, "time with the digits of its samples", FROM_FIRST)
    _refuse_coarse(values, fail)
    # double precision keeps 0.24 µs of such a time: far less than any delay that is looked for between two channels
    return Time(values - first, f"UNIX time counted from the first row ({first:.6f})")


def _refuse_coarse(values: FloatArray, fail: Fail) -> None:
    """Refuse time by which most samples were taken at once: rates, lags and creep of such a loop would be made up."""
    with np.errstate(over="ignore"):  # times near the largest number are refused later, with their row
        steps = np.diff(values)
        on = steps[steps > 0.0]
        fine = bool(on.size) and float(np.median(on)) < COARSE_S * (1.0 - EXACT)
    again = np.flatnonzero(steps == 0.0)
    if fine or 2 * again.size <= values.size:
        return
    row = int(again[0]) + 2
    found = f"{values[row - 1]:.15g}, the time of the row before, as in {again.size} of {values.size} rows"
    raise fail(row, TIME, found, "a time of its own for each sample", "export the time with more decimal places")
