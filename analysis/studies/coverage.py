"""Does the stated uncertainty hold? Units measured once each with errors, against what they truly are.

For a metric to pass, U (k = 2) must contain the error of nearly 95 % of the units, and what all units are wrong by in
the same direction (bias) must be small beside U.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from analysis.evaluation.metric_result import MetricResult
from analysis.loop.method import MetricWanted

Pair = tuple[Sequence[MetricResult], Sequence[MetricResult]]
"""Metrics of one unit: true, and as measured."""


@dataclass(frozen=True)
class CoverageRow:
    """One metric, its sides together: mean of the true values, bias and standard deviation of the error.

    expanded: median U; largest, largest_relative: the largest U of any unit, and over its value; covered: share of
    `count` values, of `units` units, whose error is within U.
    """

    metric: str
    unit: str
    value: float
    bias: float
    deviation: float
    expanded: float
    largest: float
    largest_relative: float
    covered: float
    count: int
    units: int

    @property
    def bias_over_u(self) -> float:
        """Bias in units of U; less than a fifth is wanted."""
        return abs(self.bias) / self.expanded

    @property
    def covered_between(self) -> tuple[float, float]:
        """Interval of 95 % for the share covered of all such units (Clopper and Pearson).

        Sides of a unit share its errors, so a unit counts once, with the share of its sides that is covered.
        """
        hit = self.covered * self.units
        missed = self.units - hit
        low = special.betaincinv(hit, missed + 1.0, 0.025) if hit > 0.0 else 0.0
        high = special.betaincinv(hit + 1.0, missed, 0.975) if missed > 0.0 else 1.0
        return float(low), float(high)


def coverage(wanted: Sequence[MetricWanted], pairs: Iterable[Pair]) -> list[CoverageRow]:
    """Compare what was measured of units with what is true; a metric that no unit has a value of has no row.

    A value without an uncertainty, or none where there is a true one, counts as not covered.
    """
    found: list[list[tuple[float, float, float]]] = [[] for _ in wanted]
    units = 0
    names: list[str] = []
    for truth, shown in pairs:
        units += 1
        names = [one.definition.unit for one in shown]
        for row, true, seen in zip(found, truth, shown, strict=True):
            for exact, side in zip(true.sides, seen.sides, strict=True):
                if exact.value is None or side.value is None or side.uncertainty is None:
                    row.append((np.nan, np.nan, np.nan))
                else:
                    row.append((exact.value, side.value - exact.value, side.uncertainty))
    return [
        _row(one, unit, values, units)
        for one, unit, values in zip(wanted, names, found, strict=True)
        if not np.isnan(values).all()
    ]


def _row(wanted: MetricWanted, unit: str, values: list[tuple[float, float, float]], units: int) -> CoverageRow:
    exact, error, expanded = np.array(values).T
    return CoverageRow(
        metric=wanted.id if wanted.branch is None else f"{wanted.id} {wanted.branch}",
        unit=unit,
        value=float(np.nanmean(exact)),
        bias=float(np.nanmean(error)),
        deviation=float(np.nanstd(error, ddof=1)),
        expanded=float(np.nanmedian(expanded)),
        largest=float(np.nanmax(expanded)),
        largest_relative=float(np.nanmax(expanded / np.maximum(np.abs(exact), 1e-9))),
        covered=float((np.abs(error) <= expanded).mean()),
        count=error.size,
        units=units,
    )
