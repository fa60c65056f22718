"""Shares of a count: yield with its confidence interval, and causes in the order of how often they came (Pareto).

Interval: C. Clopper and E. Pearson (1934), exact by the beta distribution, so that 40 of 40 is no certainty.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import scipy  # loads special where it is used

from analysis.line.samples import checked_level
from analysis.trace.errors import AnalysisError


class Proportion(NamedTuple):
    """How many of how many, the share (None of nothing) and its two-sided confidence interval, 0…1."""

    number: int
    of: int
    share: float | None
    low: float
    high: float


class Cause(NamedTuple):
    """A cause with its count, its share of all counts, and the share of all causes down to it, 0…1."""

    name: str
    number: int
    share: float
    cumulative: float


def proportion(count: int, of: int, level: float = 0.95) -> Proportion:
    """Return a share with its interval; of nothing the interval is 0…1.

    Raises AnalysisError for a count that is negative or larger than what it is of, or a level outside 0.5…1.
    """
    checked_level(level)
    if not 0 <= count <= of:
        raise AnalysisError(f"share: found a count of {count} out of {of}; expected 0 to {of}")
    tail = 0.5 * (1.0 - level)
    low = float(scipy.special.betaincinv(count, of - count + 1, tail)) if count else 0.0
    high = float(scipy.special.betaincinv(count + 1, of - count, 1.0 - tail)) if count < of else 1.0
    return Proportion(count, of, count / of if of else None, low, high)


def pareto(counts: Mapping[str, int]) -> tuple[Cause, ...]:
    """Return causes from the commonest to the rarest, equals by name; what never came is left out."""
    whole = sum(counts.values())
    found, so_far = [], 0
    for name, count in sorted(counts.items(), key=lambda item: (-item[1], item[0])):
        if count < 0:
            raise AnalysisError(f"Pareto chart: {name}: found a count of {count}; expected 0 or more")
        if count:
            so_far += count
            found.append(Cause(name, count, count / whole, so_far / whole))
    return tuple(found)
