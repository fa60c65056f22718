"""Control chart of a metric: subgroup means and their ranges or standard deviations, or single values.

Single values stand beside moving ranges. Limits are 3 standard deviations of what is plotted, from the spread within
subgroups; their constants are computed from the normal distribution and typed nowhere. Source: W. Shewhart;
D. Montgomery, Introduction to Statistical Quality Control, chapter 6; ISO 7870-2. Which signals are looked for, and
what that costs in false alarms: `run_rules`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import scipy  # loads special where it is used

from analysis.line.gage_study import range_constants
from analysis.line.run_rules import RULE_SETS, Signal, signals
from analysis.line.samples import checked_row, has_spread
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

SpreadKind = Literal["range", "standard deviation", "moving range"]

SIGMAS = 3.0
"""Distance of the control limits in standard deviations of what is plotted."""

LEAST_SUBGROUPS = 2
LARGEST_SUBGROUP = 25
RANGE_UP_TO = 10
"""Subgroups of up to so many values use the range by default; a larger one loses too much by it (Montgomery 6.3)."""


class Limits(NamedTuple):
    """Centre line and control limits."""

    centre: float
    low: float
    high: float


@dataclass(frozen=True)
class ControlChart:
    """A chart: what is plotted, its limits and what rules say of it.

    means: subgroup means, or single values with subgroup 1. spreads: range or standard deviation of each subgroup, or
    the moving range, which begins with the second value. sd_within: standard deviation of a value within subgroups.
    signals: of the means, by their rules; spread_signals: numbers, from 1, of spreads beyond their limits. baseline:
    how many subgroups made the limits. left_over: values at the end that fill no subgroup.
    """

    subgroup: int
    kind: SpreadKind
    means: tuple[float, ...]
    spreads: tuple[float, ...]
    mean_limits: Limits
    spread_limits: Limits
    sd_within: float
    signals: tuple[Signal, ...]
    spread_signals: tuple[int, ...]
    baseline: int
    left_over: int

    @property
    def in_control(self) -> bool:
        """Whether nothing is signalled."""
        return not self.signals and not self.spread_signals


@functools.cache
def sd_constants(count: int) -> tuple[float, float]:
    """Return c₄, mean of the standard deviation of `count` standard normal values, and the spread of it √(1 − c₄²)."""
    mean = math.sqrt(2.0 / (count - 1)) * math.exp(
        scipy.special.gammaln(count / 2) - scipy.special.gammaln((count - 1) / 2)
    )
    return mean, math.sqrt(1.0 - mean**2)


def spread_constants(kind: SpreadKind, count: int) -> tuple[float, float]:
    """Return mean and spread of the range (d₂, d₃) or standard deviation of `count` standard normal values."""
    if kind == "standard deviation":
        return sd_constants(count)
    mean, root_mean_square = range_constants(count)
    return mean, math.sqrt(root_mean_square**2 - mean**2)


def limits_of(mean: float, mean_spread: float, kind: SpreadKind, subgroup: int) -> tuple[float, Limits, Limits]:
    """Return the standard deviation within, the limits of the means, and those of the spreads.

    mean: of all values. mean_spread: mean of the subgroups' ranges or standard deviations, or of the moving ranges of
    two neighbours. subgroup: values of a subgroup, 1 for a chart of single values.
    """
    expected, scatter = spread_constants(kind, 2 if kind == "moving range" else subgroup)
    sd = mean_spread / expected
    reach = SIGMAS * sd / math.sqrt(subgroup)
    low, high = (max(0.0, sd * (expected + side * SIGMAS * scatter)) for side in (-1.0, 1.0))
    return sd, Limits(mean, mean - reach, mean + reach), Limits(mean_spread, low, high)


def control_chart(
    values: Sequence[float] | FloatArray,
    subgroup: int = 5,
    rules: Sequence[str] = RULE_SETS["shewhart"],
    *,
    kind: Literal["range", "standard deviation"] | None = None,
    baseline: int | None = None,
) -> ControlChart:
    """Chart values in the order of production.

    subgroup: values made together; 1 plots single values beside moving ranges. kind: spread of a subgroup; None takes
    the range up to 10 values. baseline: how many of the first subgroups make the limits; None: all. Raises
    AnalysisError for fewer than 2 whole subgroups, a subgroup above 25, values that are not finite, or no spread.
    """
    row = checked_row(values, "control chart", 2)
    if not 1 <= subgroup <= LARGEST_SUBGROUP:
        raise AnalysisError(f"control chart: subgroups of {subgroup} values; expected 1 to {LARGEST_SUBGROUP}")
    groups = row.size // subgroup
    if groups < LEAST_SUBGROUPS:
        raise AnalysisError(
            f"control chart: {row.size} values fill {groups} subgroups of {subgroup}; expected 2 or more. Choose "
            "smaller subgroups or measure more units"
        )
    used = groups if baseline is None else baseline
    if not LEAST_SUBGROUPS <= used <= groups:
        raise AnalysisError(
            f"control chart: limits from the first {used} of {groups} subgroups; expected {LEAST_SUBGROUPS} to {groups}"
        )
    whole = row[: groups * subgroup].reshape(groups, subgroup)
    means = whole.mean(axis=1)
    chosen: SpreadKind
    if subgroup == 1:
        chosen, spreads = "moving range", np.abs(np.diff(row))
    elif kind == "standard deviation" or (kind is None and subgroup > RANGE_UP_TO):
        chosen, spreads = "standard deviation", whole.std(axis=1, ddof=1)
    else:
        chosen, spreads = "range", np.ptp(whole, axis=1)
    mean_spread = float(spreads[: used - 1 if subgroup == 1 else used].mean())
    if not has_spread(mean_spread, row):
        raise AnalysisError("control chart: values within subgroups are identical; check whether they were rounded")
    sd, of_means, of_spreads = limits_of(float(means[:used].mean()), mean_spread, chosen, subgroup)
    standing = (means - of_means.centre) / (sd / math.sqrt(subgroup))
    beyond = (spreads > of_spreads.high) | (spreads < of_spreads.low)
    first = 2 if subgroup == 1 else 1
    return ControlChart(
        subgroup=subgroup,
        kind=chosen,
        means=tuple(means.tolist()),
        spreads=tuple(spreads.tolist()),
        mean_limits=of_means,
        spread_limits=of_spreads,
        sd_within=sd,
        signals=signals(standing, rules),
        spread_signals=tuple(int(place) + first for place in np.flatnonzero(beyond)),
        baseline=used,
        left_over=row.size - groups * subgroup,
    )
