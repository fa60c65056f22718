"""Gage study: how much of the spread of measurements comes from the measuring, by analysis of variance.

Source: AIAG Measurement Systems Analysis, 4th edition; crossed design with operator and part as random. Confidence
intervals are generalised (S. Weerahandi; Hamada and Weerahandi 2000): mean squares drawn from their chi-square laws.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import stats

from analysis.line.gage_design import GageDesign
from analysis.line.samples import checked_level
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

POOL_ABOVE = 0.25
"""The interaction is pooled with repeatability when its p value is above this (AIAG)."""

NDC_FACTOR = 1.41
"""ndc = 1.41 · part spread / gage spread, rounded down (AIAG); 1.41 stands for √2."""

DRAWS = 20_000
SEED = 20_000_101
"""Confidence intervals repeat to the last digit."""


class Source(NamedTuple):
    """A row of the analysis of variance."""

    sum_of_squares: float
    freedom: int

    @property
    def mean_square(self) -> float:
        """Sum of squares per degree of freedom."""
        return self.sum_of_squares / self.freedom


class Interval(NamedTuple):
    """An estimate and its two-sided confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class GageStudy:
    """Result of the analysis of variance.

    Sources part, operator, interaction and repeatability as found; pooled tells whether the interaction was joined with
    repeatability; p_interaction its p value. Standard deviations of the components and of the gage (repeatability and
    reproducibility), each with its interval; grr_pct: gage spread as % of study variation (the total spread);
    tolerance_pct: six gage standard deviations as % of the tolerance, None without one; ndc: number of distinct
    categories.
    """

    part: Source
    operator: Source
    interaction: Source
    repeatability: Source
    pooled: bool
    p_interaction: float
    sd_repeatability: Interval
    sd_reproducibility: Interval
    sd_gage: Interval
    sd_part: Interval
    sd_total: Interval
    grr_pct: Interval
    tolerance_pct: float | None
    ndc: int


def analyse_gage_study(
    design: GageDesign, tolerance: float | None = None, level: float = 0.95, pool_above: float = POOL_ABOVE
) -> GageStudy:
    """Analyse a gage study; pool_above 1 never pools the interaction, 0 always.

    Raises AnalysisError for a level of confidence outside 0.5…1 and for readings that all are the same. Variances
    that come out negative count as zero.
    """
    checked_level(level)
    part, operator, interaction, repeatability = sums_of_squares(design.values)
    if not np.ptp(design.values) > 0.0:
        raise AnalysisError(
            f"gage study: every reading is {float(design.values.flat[0]):g}; expected different "
            "readings; check the gage resolution and the entered values"
        )
    ratio = interaction.mean_square / repeatability.mean_square if repeatability.sum_of_squares > 0.0 else math.inf
    p = float(stats.f.sf(ratio, interaction.freedom, repeatability.freedom))
    pooled = p > pool_above
    rows = [part, operator, interaction, repeatability]
    if pooled:
        both = Source(
            interaction.sum_of_squares + repeatability.sum_of_squares, interaction.freedom + repeatability.freedom
        )
        rows = [part, operator, both, both]
    random = np.random.default_rng(SEED)
    drawn = np.stack([row.sum_of_squares / random.chisquare(row.freedom, DRAWS) for row in rows])
    if pooled:
        drawn[3] = drawn[2]
    estimates = _spreads(np.array([[row.mean_square] for row in rows]), design.values.shape)
    intervals = np.quantile(_spreads(drawn, design.values.shape), [0.5 - 0.5 * level, 0.5 + 0.5 * level], axis=1)
    found = [Interval(*(float(x) for x in row)) for row in zip(estimates[:, 0], *intervals, strict=True)]
    repeat, between, gage, unit, total, share = found
    return GageStudy(
        part=part,
        operator=operator,
        interaction=interaction,
        repeatability=repeatability,
        pooled=pooled,
        p_interaction=p,
        sd_repeatability=repeat,
        sd_reproducibility=between,
        sd_gage=gage,
        sd_part=unit,
        sd_total=total,
        grr_pct=share,
        tolerance_pct=share_of_tolerance(gage.value, tolerance),
        ndc=distinct_categories(unit.value, gage.value),
    )


def sums_of_squares(values: FloatArray) -> tuple[Source, Source, Source, Source]:
    """Rows part, operator, interaction and repeatability of the analysis of variance of (part, operator, trial)."""
    parts, operators, trials = values.shape
    mean = float(values.mean())
    by_part, by_operator, by_cell = values.mean(axis=(1, 2)), values.mean(axis=(0, 2)), values.mean(axis=2)
    part = operators * trials * float(np.square(by_part - mean).sum())
    operator = parts * trials * float(np.square(by_operator - mean).sum())
    interaction = trials * float(np.square(by_cell - by_part[:, None] - by_operator[None, :] + mean).sum())
    return (
        Source(part, parts - 1),
        Source(operator, operators - 1),
        Source(interaction, (parts - 1) * (operators - 1)),
        Source(float(np.square(values - by_cell[:, :, None]).sum()), parts * operators * (trials - 1)),
    )


def share_of_tolerance(sd_gage: float, tolerance: float | None) -> float | None:
    """Six gage standard deviations as % of a tolerance (upper minus lower limit); AnalysisError unless above 0."""
    if tolerance is None:
        return None
    if not 0.0 < tolerance < math.inf:
        raise AnalysisError(f"gage study: tolerance {tolerance}; expected upper minus lower limit, above zero")
    return 100.0 * 6.0 * sd_gage / tolerance


def distinct_categories(sd_part: float, sd_gage: float) -> int:
    """Return ndc: how many groups of parts the gage tells apart, at least 1; a gage without spread counts 1000."""
    if sd_gage <= 1e-3 * sd_part:
        return 1000
    return max(1, math.floor(NDC_FACTOR * sd_part / sd_gage))


def _spreads(mean_squares: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Standard deviations repeatability, reproducibility, gage, part, total, and the gage as % of total; per column."""
    parts, operators, trials = shape
    part, operator, interaction, repeat = mean_squares
    crossed = np.maximum((interaction - repeat) / trials, 0.0)
    between = np.maximum((operator - interaction) / (parts * trials), 0.0) + crossed
    unit = np.maximum((part - interaction) / (operators * trials), 0.0)
    gage = repeat + between
    total = gage + unit
    share = 100.0 * np.sqrt(np.divide(gage, total, out=np.zeros_like(total), where=total > 0.0))
    return np.concatenate([np.sqrt([repeat, between, gage, unit, total]), [share]])
