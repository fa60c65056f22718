"""Rows of numbers as the statistics take them: checked once, with an error that says which one is wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

LARGEST = 1e12
"""Larger magnitudes are refused: squares of it still are finite, and no metric reaches it."""


def checked_row(values: Sequence[float] | FloatArray, what: str, least: int) -> FloatArray:
    """Return one-dimensional finite numbers; AnalysisError for fewer than `least`, or naming the first wrong one."""
    try:
        row = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise AnalysisError(f"{what}: {error}; expected numbers") from error
    if row.ndim != 1 or row.size < least:
        raise AnalysisError(
            f"{what}: found {row.size} value{'s' * (row.size != 1)}; expected {least} or more in one row"
        )
    bad = ~(np.abs(row) <= LARGEST)
    if bad.any():
        place = int(np.argmax(bad)) + 1
        raise AnalysisError(
            f"{what}: value {place} is {row[place - 1]}; expected a finite number; remove or correct it"
        )
    return row


ROUNDING = 1e-12
"""Spread of values that is rounding of the computer, as a share of the largest value: it is none of a process."""


def has_spread(spread: float, row: FloatArray) -> bool:
    """Whether a spread of these values is more than rounding, which the variance of identical values may leave."""
    return spread > ROUNDING * float(np.abs(row).max())


def checked_level(level: float) -> float:
    """Return a level of confidence; AnalysisError unless it is between 0.5 and 1."""
    if not 0.5 <= level < 1.0:
        raise AnalysisError(f"level of confidence: found {level}; expected 0.5 up to below 1, usually 0.95")
    return level
