"""Gage study by average and range: the hand method, for comparison with older studies.

Source: AIAG Measurement Systems Analysis, 4th edition. Its constants K1, K2, K3 are computed from the law of the range
of normal values, and so are the confidence intervals.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy import stats

from analysis.line.gage_design import GageDesign
from analysis.line.gage_study import SEED, Interval, distinct_categories, share_of_tolerance
from analysis.line.samples import checked_level
from analysis.trace.units import FloatArray

DRAWS = 4000

INTEGRATION_SPAN = 8.0
INTEGRATION_POINTS = 801
"""Normal density beyond 8 is below the rounding of a float; the grid gives the constants to four digits."""


@dataclass(frozen=True)
class AverageRange:
    """Standard deviations EV, AV, GRR, PV and TV of AIAG, with their intervals; names as in GageStudy.

    The part spread is that of the parts' averages, as AIAG has it: a share of the gage is in it.
    """

    sd_repeatability: Interval
    sd_reproducibility: Interval
    sd_gage: Interval
    sd_part: Interval
    sd_total: Interval
    grr_pct: Interval
    tolerance_pct: float | None
    ndc: int


@functools.cache
def range_constants(count: int) -> tuple[float, float]:
    """Return d₂ (mean range of `count` standard normal values) and d₂* of one group (root mean square range)."""
    x = np.linspace(-INTEGRATION_SPAN, INTEGRATION_SPAN, INTEGRATION_POINTS)
    step = float(x[1] - x[0])
    below = stats.norm.cdf(x)
    mean = float((1.0 - below**count - (1.0 - below) ** count).sum()) * step
    low, high = below[:, None], below[None, :]
    # P(smallest ≤ x, largest > y) over x < y integrates to half the mean square of the range
    joint = 1.0 - high**count - (1.0 - low) ** count + np.maximum(high - low, 0.0) ** count
    weight = np.triu(np.ones_like(joint), 1) + 0.5 * np.eye(x.size)
    return mean, float(np.sqrt(2.0 * (joint * weight).sum())) * step


def analyse_average_range(design: GageDesign, tolerance: float | None = None, level: float = 0.95) -> AverageRange:
    """Analyse a gage study by average and range; AnalysisError for a level of confidence outside 0.5…1."""
    checked_level(level)
    values = design.values
    parts, operators, trials = values.shape
    ranges = np.array(
        [np.ptp(values, axis=2).mean(), np.ptp(values.mean(axis=(0, 2))), np.ptp(values.mean(axis=(1, 2)))]
    )
    expected = np.array([range_constants(trials)[0], range_constants(operators)[1], range_constants(parts)[1]])
    estimates = _spreads((ranges / expected)[:, None], parts * trials)
    random = np.random.default_rng(SEED)
    drawn = np.stack(
        [
            np.ptp(random.standard_normal((DRAWS, operators)), axis=1),
            np.ptp(random.standard_normal((DRAWS, parts)), axis=1),
        ]
    )
    repeat = np.array(
        [np.ptp(random.standard_normal((parts * operators, trials)), axis=1).mean() for _ in range(DRAWS)]
    )
    spreads = _spreads(ranges[:, None] / np.vstack([repeat, drawn]), parts * trials)
    limits = np.quantile(spreads, [0.5 - 0.5 * level, 0.5 + 0.5 * level], axis=1)
    found = [Interval(*(float(x) for x in row)) for row in zip(estimates[:, 0], *limits, strict=True)]
    repeatability, reproducibility, gage, part, total, share = found
    return AverageRange(
        sd_repeatability=repeatability,
        sd_reproducibility=reproducibility,
        sd_gage=gage,
        sd_part=part,
        sd_total=total,
        grr_pct=share,
        tolerance_pct=share_of_tolerance(gage.value, tolerance),
        ndc=distinct_categories(part.value, gage.value),
    )


def _spreads(scaled: FloatArray, per_operator: int) -> FloatArray:
    """EV, AV, GRR, PV, TV and GRR as % of TV from ranges over their constants; per column."""
    repeat, operator, part = scaled
    between = np.sqrt(np.maximum(operator**2 - repeat**2 / per_operator, 0.0))
    gage = np.hypot(repeat, between)
    total = np.hypot(gage, part)
    share = 100.0 * np.divide(gage, total, out=np.zeros_like(total), where=total > 0.0)
    return np.stack([repeat, between, gage, part, total, share])
