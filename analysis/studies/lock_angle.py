"""Does it matter where the shaft is locked? Metrics over lock positions: their spread, and whether they go together.

Source: "stiffness characterization", table 1 (14 positions of one reducer).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy  # loads stats where it is used

from analysis.line.samples import checked_level, checked_row
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

LEAST_POSITIONS = 4
"""A correlation and its interval need one more than Fisher's three."""


class Spread(NamedTuple):
    """One metric over positions; sd is the standard uncertainty that an unknown lock position adds."""

    mean: float
    sd: float
    least: float
    most: float


class Correlation(NamedTuple):
    """Of two metrics over positions: coefficient, confidence interval (Fisher), p value of none."""

    first: str
    second: str
    coefficient: float
    low: float
    high: float
    p_none: float


@dataclass(frozen=True)
class LockAngleStudy:
    """Number of positions, spread of each metric, correlation of each pair (None of them for a constant metric)."""

    positions: int
    spreads: Mapping[str, Spread]
    correlations: tuple[Correlation, ...]


def lock_angle_study(metrics: Mapping[str, Sequence[float] | FloatArray], level: float = 0.95) -> LockAngleStudy:
    """Study metrics by name, each with one value per lock position, in the same order.

    Raises AnalysisError for fewer than 4 positions, or metrics with different numbers of them.
    """
    checked_level(level)
    if not metrics:
        raise AnalysisError("lock angle: found no metric; give at least one metric with a value for each lock position")
    rows = {name: checked_row(values, f"lock angle: {name}", LEAST_POSITIONS) for name, values in metrics.items()}
    sizes = {name: row.size for name, row in rows.items()}
    if len(set(sizes.values())) > 1:
        found = ", ".join(f"{name} has {size}" for name, size in sizes.items())
        raise AnalysisError(f"lock angle: {found} positions; expected one value of each metric per position")
    spreads = {
        name: Spread(float(row.mean()), float(row.std(ddof=1)), float(row.min()), float(row.max()))
        for name, row in rows.items()
    }
    names = [name for name in rows if spreads[name].sd > 0.0]
    pairs = [
        _correlation(first, second, rows[first], rows[second], level)
        for number, first in enumerate(names)
        for second in names[number + 1 :]
    ]
    return LockAngleStudy(next(iter(sizes.values())), spreads, tuple(pairs))


def _correlation(first: str, second: str, x: FloatArray, y: FloatArray, level: float) -> Correlation:
    r = float(np.clip(scipy.stats.pearsonr(x, y).statistic, -1.0, 1.0))
    p = float(scipy.stats.pearsonr(x, y).pvalue)
    if abs(r) >= 1.0 - 1e-12:
        return Correlation(first, second, r, r, r, p)
    half = float(scipy.stats.norm.ppf(0.5 + 0.5 * level)) / math.sqrt(x.size - 3)
    low, high = (math.tanh(math.atanh(r) + sign * half) for sign in (-1.0, 1.0))
    return Correlation(first, second, r, low, high, p)
