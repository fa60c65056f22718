"""Capability of a process against its limits: Cp and Cpk from the spread within, Pp and Ppk from the whole spread.

With one limit only the side that exists counts: Cp and Pp are not defined then, Cpk and Ppk are. Source: ISO 22514-2;
confidence of
Cp and Pp by chi-square, of Cpk and Ppk after A. Bissell (1990), "How reliable is your capability index?".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # loads special where it is used

from analysis.line.samples import checked_level, checked_row, has_spread
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

MOVING_RANGE = 2.0 / math.sqrt(math.pi)
"""d₂ for two values (1.128): mean moving range over it estimates the standard deviation within."""


@dataclass(frozen=True)
class Indices:
    """Indices of one spread: both sides (None with one limit), and the nearer side."""

    both: float | None
    nearest: float


@dataclass(frozen=True)
class Capability:
    """What a sample says about a process.

    within: Cp and Cpk with the standard deviation within subgroups; overall: Pp and Ppk with that of all values.
    cp_low … ppk_high: confidence interval of each index; None for Cp and Pp with one limit. outside_fraction: expected
    beyond the limits, if normal.
    """

    within: Indices
    overall: Indices
    cpk_low: float
    cpk_high: float
    cp_low: float | None
    cp_high: float | None
    pp_low: float | None
    pp_high: float | None
    ppk_low: float
    ppk_high: float
    mean: float
    sd_within: float
    sd_overall: float
    outside_fraction: float
    lower: float | None
    upper: float | None
    values: int


def indices(mean: float, sd: float, lower: float | None, upper: float | None) -> Indices:
    """Capability indices of a normal process with known mean and standard deviation.

    Raises AnalysisError without a limit, for limits in the wrong order, or a standard deviation that is not above zero.
    """
    if lower is None and upper is None:
        raise AnalysisError("capability: no limit; give lower, upper or both")
    if lower is not None and upper is not None and not lower < upper:
        raise AnalysisError(
            f"capability: limits {lower:g} and {upper:g}; the lower limit must be smaller than the upper one"
        )
    if not all(math.isfinite(limit) for limit in (lower, upper) if limit is not None):
        raise AnalysisError(
            f"capability: limits {lower} and {upper}; both must be finite numbers. Where there is no "
            "limit on one side, omit it"
        )
    if not (sd > 0.0 and math.isfinite(sd) and math.isfinite(mean)):
        raise AnalysisError(
            f"capability: mean {mean:g}, standard deviation {sd:g}; expected a standard deviation above zero"
        )
    sides = [] if lower is None else [(mean - lower) / (3.0 * sd)]
    if upper is not None:
        sides.append((upper - mean) / (3.0 * sd))
    both = None if lower is None or upper is None else (upper - lower) / (6.0 * sd)
    return Indices(both, min(sides))


def capability(
    values: Sequence[float] | FloatArray,
    lower: float | None = None,
    upper: float | None = None,
    subgroup: int = 1,
    level: float = 0.95,
) -> Capability:
    """Estimate capability from values in the order of production.

    subgroup: values made together; 1 takes the moving range of neighbours, more pools the variances within (a last
    subgroup that is not full counts in the whole spread only). Raises AnalysisError for fewer than 3 values or 2 whole
    subgroups, values that are not finite, no spread, or limits as `indices` says.
    """
    row = checked_row(values, "capability", 3)
    checked_level(level)
    sd_within, freedom = _within(row, subgroup)
    if not has_spread(sd_within, row):
        raise AnalysisError(
            "capability: the values, or those of each subgroup, are identical; expected a standard deviation above "
            "zero. Check whether they were rounded too coarsely"
        )
    mean, sd_overall = float(row.mean()), float(row.std(ddof=1))
    within = indices(mean, sd_within, lower, upper)
    overall = indices(mean, sd_overall, lower, upper)
    below, above = (math.inf if limit is None else (limit - mean) / sd_overall for limit in (lower, upper))
    outside = (0.0 if lower is None else float(scipy.special.ndtr(below))) + float(scipy.special.ndtr(-above))
    cp, pp = (
        (None, None) if one.both is None else interval_of_both(one.both, free, level)
        for one, free in ((within, freedom), (overall, row.size - 1.0))
    )
    cpk = interval_of_nearest(within.nearest, row.size, freedom, level)
    ppk = interval_of_nearest(overall.nearest, row.size, row.size - 1.0, level)
    return Capability(
        within=within,
        overall=overall,
        cpk_low=cpk[0],
        cpk_high=cpk[1],
        cp_low=cp[0],
        cp_high=cp[1],
        pp_low=pp[0],
        pp_high=pp[1],
        ppk_low=ppk[0],
        ppk_high=ppk[1],
        mean=mean,
        sd_within=sd_within,
        sd_overall=sd_overall,
        outside_fraction=outside,
        lower=lower,
        upper=upper,
        values=row.size,
    )


def interval_of_both(index: float, freedom: float, level: float) -> tuple[float, float]:
    """Confidence interval of Cp or Pp: the variance of its spread is chi-square of so many degrees of freedom."""
    low, high = (
        math.sqrt(float(scipy.special.chdtri(freedom, 0.5 - 0.5 * side * level)) / freedom) for side in (-1, 1)
    )
    return index * low, index * high


def interval_of_nearest(index: float, values: int, freedom: float, level: float) -> tuple[float, float]:
    """Confidence interval of Cpk or Ppk: by the mean of all values, and the spread of its degrees of freedom."""
    z = float(scipy.special.ndtri(0.5 + 0.5 * level))
    half = z * math.sqrt(1.0 / (9.0 * values) + index**2 / (2.0 * freedom))
    return index - half, index + half


def _within(row: FloatArray, subgroup: int) -> tuple[float, float]:
    """Standard deviation within subgroups and its degrees of freedom."""
    if subgroup == 1:
        # neighbouring moving ranges share a value: about 0.62 degrees of freedom each
        return float(np.abs(np.diff(row)).mean()) / MOVING_RANGE, 0.62 * (row.size - 1)
    groups = row.size // subgroup if subgroup > 1 else 0
    if groups < 2:
        raise AnalysisError(
            f"capability: subgroups of {subgroup} in {row.size} values; expected 2 whole subgroups or more. Choose "
            f"smaller subgroups or measure more units"
        )
    whole = row[: groups * subgroup].reshape(groups, subgroup)
    return math.sqrt(float(whole.var(axis=1, ddof=1).mean())), float(groups * (subgroup - 1))
