"""Do groups differ: one metric by bench, shift, operator or day, from the sums of each group alone.

One-way analysis of variance with fixed groups (Montgomery, Design and Analysis of Experiments, chapter 3). Sums are
enough, so that a database may form them; they are of the distance from a common origin near the mean, or rounding would
take the spread away.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import scipy  # loads special where it is used

from analysis.line.samples import checked_level
from analysis.trace.errors import AnalysisError

LEAST_GROUPS = 2


class Sums(NamedTuple):
    """Number of values of a group, the sum of their distances from the origin, and that of the squares of these."""

    number: int
    first: float
    second: float


class Group(NamedTuple):
    """A group: its number of values, mean, standard deviation (None of one value) and the interval of its mean.

    The interval is by the spread within all groups; a group apart from the others is one whose interval does not hold
    the mean of all.
    """

    name: str
    number: int
    mean: float
    sd: float | None
    low: float
    high: float


class GroupsCompared(NamedTuple):
    """Groups in the order they were given.

    sd_within: spread within groups. sd_between: spread of the groups' true means beyond what their numbers of values
    explain, 0 where nothing is left. p_same: p value of all means being the same. share_between: of the variance of
    all values, what lies between the groups, 0…1.
    """

    groups: tuple[Group, ...]
    mean: float
    sd_within: float
    sd_between: float
    p_same: float
    share_between: float


def compare_groups(sums: Mapping[str, Sums], origin: float = 0.0, level: float = 0.95) -> GroupsCompared:
    """Compare groups; raises AnalysisError for fewer than 2, an empty one, or no group of more than one value."""
    checked_level(level)
    if len(sums) < LEAST_GROUPS:
        raise AnalysisError(
            f"groups: found {len(sums)} to compare ({', '.join(sums) or 'none'}); expected {LEAST_GROUPS} or more"
        )
    for name, one in sums.items():
        if one.number < 1 or not (math.isfinite(one.first) and math.isfinite(one.second)):
            raise AnalysisError(
                f"groups: {name}: found {one.number} values with the sum {one.first}; expected 1 or more finite numbers"
            )
    total = sum(one.number for one in sums.values())
    freedom = total - len(sums)
    if freedom < 1:
        raise AnalysisError(
            "groups: every group has one value; expected a group with two or more values. Measure more units"
        )
    mean = sum(one.first for one in sums.values()) / total
    within = sum(_square_within(one) for one in sums.values())
    between = sum(one.number * (one.first / one.number - mean) ** 2 for one in sums.values())
    variance = within / freedom
    ratio = math.inf if not variance > 0.0 else between / (len(sums) - 1) / variance
    effective = (total - sum(one.number**2 for one in sums.values()) / total) / (len(sums) - 1)
    reach = float(scipy.special.stdtrit(freedom, 0.5 + 0.5 * level)) * math.sqrt(variance)
    found = []
    for name, one in sums.items():
        middle, half = origin + one.first / one.number, reach / math.sqrt(one.number)
        sd = None if one.number < 2 else math.sqrt(_square_within(one) / (one.number - 1))
        found.append(Group(name, one.number, middle, sd, middle - half, middle + half))
    return GroupsCompared(
        groups=tuple(found),
        mean=origin + mean,
        sd_within=math.sqrt(variance),
        sd_between=math.sqrt(max(0.0, between / (len(sums) - 1) - variance) / effective),
        p_same=float(scipy.special.fdtrc(len(sums) - 1, freedom, ratio)),
        share_between=between / (between + within) if between + within > 0.0 else 0.0,
    )


def _square_within(one: Sums) -> float:
    """Sum of squares of a group about its own mean."""
    return max(0.0, one.second - one.first**2 / one.number)
