"""Gage study: how much of the spread of measurements comes from the measuring.

By analysis of variance, and by average and range, the hand method, for comparison with older studies. Source: AIAG
Measurement Systems Analysis, 4th edition; crossed design, every operator measures every part the same number of times,
with operator and part as random. Confidence intervals are generalised (S. Weerahandi; Hamada and Weerahandi 2000): mean
squares drawn from their chi-square laws, ranges from theirs, from which the hand method's constants K1, K2, K3 are
computed too.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy  # loads special where it is used

from analysis.line.samples import checked_level, checked_row
from analysis.trace.errors import AnalysisError
from analysis.trace.units import FloatArray

POOL_ABOVE = 0.25
"""The interaction is pooled with repeatability when its p value is above this (AIAG)."""

NDC_FACTOR = 1.41
"""ndc = 1.41 · part spread / gage spread, rounded down (AIAG); 1.41 stands for √2."""

DRAWS = 20_000
SEED = 20_000_101
"""Confidence intervals repeat to the last digit."""

RANGE_DRAWS = 4000

INTEGRATION_SPAN = 8.0
INTEGRATION_POINTS = 801
"""Normal density beyond 8 is below the rounding of a float; the grid gives the constants to four digits."""


@dataclass(frozen=True)
class GageDesign:
    """Measurements as an array (part, operator, trial), with the names of parts and operators."""

    values: FloatArray
    parts: tuple[str, ...]
    operators: tuple[str, ...]

    def __post_init__(self) -> None:
        """Check shape and numbers; AnalysisError for fewer than 2 parts, operators or trials."""
        values = np.asarray(self.values, dtype=np.float64)
        if values.ndim != 3 or min(values.shape) < 2:
            raise AnalysisError(
                f"gage study: found {' × '.join(str(n) for n in values.shape)} (parts × operators × trials); "
                "expected 2 or more of each"
            )
        if (len(self.parts), len(self.operators)) != values.shape[:2]:
            raise AnalysisError(
                f"gage study: {len(self.parts)} names of parts and {len(self.operators)} of operators for an array of "
                f"{values.shape[0]} × {values.shape[1]}; name each one"
            )
        checked_row(values.ravel(), "gage study", 8)
        object.__setattr__(self, "values", values)


def gage_design(operator: Sequence[str], part: Sequence[str], value: Sequence[float]) -> GageDesign:
    """Arrange measurements in any order to a balanced design.

    Raises AnalysisError when rows differ in number, or naming the part and operator that were measured more or less
    often than the others.
    """
    if not len(operator) == len(part) == len(value):
        raise AnalysisError(
            f"gage study: found {len(operator)} operators, {len(part)} parts and {len(value)} values; expected one "
            "operator, one part and one value in each row"
        )
    cells: dict[tuple[str, str], list[float]] = {}
    for who, which, measured in zip(operator, part, value, strict=True):
        cells.setdefault((which, who), []).append(measured)
    parts, operators = tuple(dict.fromkeys(part)), tuple(dict.fromkeys(operator))
    trials = max((len(cell) for cell in cells.values()), default=0)
    for which in parts:
        for who in operators:
            found = len(cells.get((which, who), []))
            if found != trials:
                raise AnalysisError(
                    f"gage study: part {which} was measured {found} times by operator {who}, others {trials} times; "
                    "complete the study"
                )
    table = np.array([[cells[which, who] for who in operators] for which in parts], dtype=np.float64)
    return GageDesign(table, parts, operators)


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

    @property
    def worse_pct(self) -> float:
        """The share that judges: of the total spread or of the tolerance, whichever is larger."""
        return self.grr_pct.value if self.tolerance_pct is None else max(self.grr_pct.value, self.tolerance_pct)

    @property
    def shares(self) -> str:
        """The shares in words."""
        of_tolerance = "" if self.tolerance_pct is None else f", {self.tolerance_pct:.3g} % of the tolerance"
        return f"{self.grr_pct.value:.3g} % of the total spread{of_tolerance}"


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
    p = float(scipy.special.fdtrc(interaction.freedom, repeatability.freedom, ratio))
    pooled = p > pool_above
    rows = [part, operator, interaction, repeatability]
    if pooled:
        both = Source(
            interaction.sum_of_squares + repeatability.sum_of_squares, interaction.freedom + repeatability.freedom
        )
        rows = [part, operator, both, both]
    squares = drawn_squares(tuple(row.freedom for row in rows))
    drawn = np.array([[row.sum_of_squares] for row in rows]) / squares
    if pooled:
        drawn[3] = drawn[2]
    estimates = _spreads_of_squares(np.array([[row.mean_square] for row in rows]), design.values.shape)
    intervals = np.quantile(
        _spreads_of_squares(drawn, design.values.shape), [0.5 - 0.5 * level, 0.5 + 0.5 * level], axis=1
    )
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


@functools.lru_cache(maxsize=8)
def drawn_squares(freedoms: tuple[int, ...]) -> FloatArray:
    """Return draws from the chi-square law of each number of degrees of freedom: a row each, the same every time."""
    random = np.random.default_rng(SEED)
    return np.stack([random.chisquare(freedom, DRAWS) for freedom in freedoms])


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


def _spreads_of_squares(mean_squares: FloatArray, shape: tuple[int, ...]) -> FloatArray:
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
    below = scipy.special.ndtr(x)
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
    estimates = _spreads_of_ranges((ranges / expected)[:, None], parts * trials)
    spreads = _spreads_of_ranges(ranges[:, None] / drawn_ranges(parts, operators, trials), parts * trials)
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


@functools.lru_cache(maxsize=8)
def drawn_ranges(parts: int, operators: int, trials: int) -> FloatArray:
    """Return ranges of standard normal values, the same every time, shape (3, draws).

    Rows: the mean over all cells of the range of a cell's trials, the range of the operators, the range of the parts.
    """
    random = np.random.default_rng(SEED)
    apart = [np.ptp(random.standard_normal((RANGE_DRAWS, count)), axis=1) for count in (operators, parts)]
    cells = (np.ptp(random.standard_normal((parts * operators, trials)), axis=1) for _ in range(RANGE_DRAWS))
    return np.stack([np.array([cell.mean() for cell in cells]), *apart])


def _spreads_of_ranges(scaled: FloatArray, per_operator: int) -> FloatArray:
    """EV, AV, GRR, PV, TV and GRR as % of TV from ranges over their constants; per column."""
    repeat, operator, part = scaled
    between = np.sqrt(np.maximum(operator**2 - repeat**2 / per_operator, 0.0))
    gage = np.hypot(repeat, between)
    total = np.hypot(gage, part)
    share = 100.0 * np.divide(gage, total, out=np.zeros_like(total), where=total > 0.0)
    return np.stack([repeat, between, gage, part, total, share])
