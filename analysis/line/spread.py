"""Spread of one metric by one-way analysis of variance: how it repeats on one unit, and how units differ.

Repeatability: over the cycles of a run, and over runs of the same unit, with runs as groups. Source: "static testing
system" (three repeats) and "backlash and stiffness measurement system"; ISO 5725-2 for the two components.
Unit to unit: how units differ, apart from how the metric repeats on one, with units as random; they may have different
numbers of measurements.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np
import scipy  # loads special where it is used

from analysis.line.samples import LARGEST, checked_level, checked_row
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray, IntArray

LEAST_RUNS = 2

UNUSUAL = 3.5
"""Units whose modified z score (0.6745·distance from the median over the MAD) is beyond this are named (Iglewicz)."""


class Repeatability(NamedTuple):
    """Spread of a metric, in its own unit."""

    runs: int
    cycles: int
    """Of all runs together."""
    mean: float
    """Of the runs' values; each run counts once."""
    sd_runs: float
    """Standard deviation of the runs' values."""
    sd_cycles: float | None
    """Standard deviation of one cycle within its run, pooled over the runs; None when every run has one cycle."""
    sd_between: float | None
    """What the runs differ by beyond what their cycles explain; 0 where nothing is left, None as above."""
    run_values: tuple[float, ...]


def repeatability(runs: Sequence[Sequence[float]]) -> Repeatability:
    """Return the spread of a metric from its values per cycle, run by run.

    Raises AnalysisError for fewer than two runs, and for a run without a finite value.
    """
    if len(runs) < LEAST_RUNS:
        raise AnalysisError(
            f"repeatability: found {len(runs)} runs; expected {LEAST_RUNS} or more of one unit. Measure again"
        )
    rows = [checked_row(values, f"repeatability: run {number}", 1) for number, values in enumerate(runs, start=1)]
    means = np.array([row.mean() for row in rows])
    counts = np.array([row.size for row in rows])
    sd_runs = float(means.std(ddof=1))
    freedom = int((counts - 1).sum())
    sd_cycles = sd_between = None
    if freedom:
        within = sum(float(np.square(row - row.mean()).sum()) for row in rows) / freedom
        sd_cycles = math.sqrt(within)
        sd_between = math.sqrt(max(0.0, sd_runs**2 - within * float(np.mean(1.0 / counts))))
    return Repeatability(
        len(rows), int(counts.sum()), float(means.mean()), sd_runs, sd_cycles, sd_between, tuple(means.tolist())
    )


@dataclass(frozen=True)
class UnitToUnit:
    """One metric over units.

    mean, median and sd of the units' means, the confidence interval of that sd; sd_within (repeatability) and sd_units
    (between units, repeatability removed), None when no unit was measured twice; least and most with their units;
    unusual units by name.
    """

    units: int
    measurements: int
    mean: float
    median: float
    sd: float
    sd_low: float
    sd_high: float
    sd_within: float | None
    sd_units: float | None
    least: tuple[str, float]
    most: tuple[str, float]
    unusual: tuple[str, ...]


def unit_to_unit(by_unit: Mapping[str, Sequence[float] | FloatArray], level: float = 0.95) -> UnitToUnit:
    """Compare units by one metric: values per serial number.

    Raises AnalysisError for fewer than 3 units, or a unit without values or with one that is not finite.
    """
    checked_level(level)
    if len(by_unit) < 3:
        raise AnalysisError(f"spread between units: found {len(by_unit)} units; expected 3 or more. Measure more units")
    values, sizes = _unit_by_unit(by_unit)
    first = np.cumsum(sizes) - sizes
    means = np.add.reduceat(values, first) / sizes
    sd = float(means.std(ddof=1))
    freedom = means.size - 1
    low, high = (sd * math.sqrt(freedom / scipy.special.chdtri(freedom, 0.5 - sign * 0.5 * level)) for sign in (1, -1))
    within, between = _components(values, sizes, means)
    names = list(by_unit)
    distance = np.abs(means - np.median(means))
    scale = float(np.median(distance))
    unusual = distance > UNUSUAL / 0.6745 * scale if scale > 0.0 else distance > 0.0
    return UnitToUnit(
        units=means.size,
        measurements=values.size,
        mean=float(means.mean()),
        median=float(np.median(means)),
        sd=sd,
        sd_low=float(low),
        sd_high=float(high),
        sd_within=within,
        sd_units=between,
        least=(names[int(np.argmin(means))], float(means.min())),
        most=(names[int(np.argmax(means))], float(means.max())),
        unusual=tuple(names[index] for index in np.flatnonzero(unusual)),
    )


def _unit_by_unit(by_unit: Mapping[str, Sequence[float] | FloatArray]) -> tuple[FloatArray, IntArray]:
    """Return all values in one row, unit by unit, and how many each unit has; AnalysisError names the unit at fault."""
    sizes = np.array([len(values) for values in by_unit.values()])
    values = np.array(list(chain.from_iterable(by_unit.values())), dtype=np.float64)
    if not (sizes.all() and (np.abs(values) <= LARGEST).all()):
        for serial, row in by_unit.items():
            checked_row(row, f"unit to unit: {serial}", 1)
    return values, sizes


def _components(values: FloatArray, sizes: IntArray, means: FloatArray) -> tuple[float | None, float | None]:
    """Standard deviations within and between units by the mean squares; values stand unit by unit."""
    total = values.size
    freedom = total - sizes.size
    if freedom < 1:
        return None, None
    within = float(np.square(values - np.repeat(means, sizes)).sum()) / freedom
    grand = float((sizes * means).sum()) / total
    between = float((sizes * np.square(means - grand)).sum()) / (sizes.size - 1)
    effective = (total - float(np.square(sizes).sum()) / total) / (sizes.size - 1)
    return math.sqrt(within), math.sqrt(max(between - within, 0.0) / effective)
