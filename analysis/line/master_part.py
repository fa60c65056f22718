"""Trend of a master part: the same reducer measured again and again tells whether the bench changes, not the product.

Individuals chart after Shewhart (standard deviation MR/1.128 from the first measurements), two run rules, a straight
line over time, and the distance from the value that was certified. The limits hold a steady bench with the probability
of three standard deviations, and are wider while the baseline is short.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy  # loads special where it is used

from analysis.line.capability import MOVING_RANGE
from analysis.line.samples import checked_level, checked_row
from analysis.trace.errors import AnalysisError
from analysis.trace.units import BoolArray, FloatArray

LEAST_BASELINE = 5
"""Measurements that the control limits are made of, at least."""

INSIDE_ONE_SIDE = 0.99865
"""Probability below three standard deviations of a normal law."""

SAME_SIDE = 8
RISING_OR_FALLING = 7
"""This many in a row by chance have a probability below half a percent."""


class Signal(NamedTuple):
    """A rule that was broken: name, number of the measurement at which (from 1), and what it means."""

    rule: str
    measurement: int
    text: str


@dataclass(frozen=True)
class MasterPart:
    """Where the bench stands.

    centre, low_limit, high_limit of the chart; slope_per_day with its standard uncertainty and p value (of no trend);
    bias against the reference value and its expanded uncertainty, None without one; signals, empty when all is well.
    """

    centre: float
    low_limit: float
    high_limit: float
    slope_per_day: float
    u_slope_per_day: float
    p_no_trend: float
    bias: float | None
    u_bias_expanded: float | None
    signals: tuple[Signal, ...]

    @property
    def in_control(self) -> bool:
        """Whether no rule was broken."""
        return not self.signals


def _wrong_baseline(baseline: int, values: int) -> str:
    """Say how many values there are and how many the baseline needs, and what to do."""
    said = f"master part: found {values} values, and a baseline of {baseline}; expected"
    if values < LEAST_BASELINE:
        return f"{said} {LEAST_BASELINE} values or more. Measure the master part more often"
    return f"{said} a baseline of {LEAST_BASELINE} to {values}. Choose another baseline, or measure more often"


def master_part_trend(
    days: Sequence[float] | FloatArray,
    values: Sequence[float] | FloatArray,
    baseline: int = 10,
    reference: tuple[float, float] | None = None,
    level: float = 0.99,
) -> MasterPart:
    """Judge measurements of a master part over time.

    days: time of each, rising; baseline: how many of the first make the limits; reference: certified value and its
    standard uncertainty. A trend counts when its p value is below 1 − level. Raises AnalysisError for fewer than 5 in
    the baseline, lengths that differ, times that do not rise, values that never change, or a reference without numbers.
    """
    when, row = checked_row(days, "master part: days", 3), checked_row(values, "master part: values", 3)
    checked_level(level)
    if when.size != row.size:
        raise AnalysisError(f"master part: {when.size} days for {row.size} values; expected one day for each value")
    if (np.diff(when) < 0.0).any() or when[-1] <= when[0]:
        raise AnalysisError("master part: the days do not rise; sort the measurements by time")
    if reference is not None and not (math.isfinite(reference[0]) and 0.0 <= reference[1] < math.inf):
        raise AnalysisError(
            f"master part: certified value {reference[0]:g} with a standard uncertainty of {reference[1]:g}; expected "
            "numbers, and an uncertainty of 0 or more. Enter both as the certificate has them"
        )
    if not LEAST_BASELINE <= baseline <= row.size:
        raise AnalysisError(_wrong_baseline(baseline, row.size))
    centre = float(row[:baseline].mean())
    sd = float(np.abs(np.diff(row[:baseline])).mean()) / MOVING_RANGE
    if not sd > 0.0:
        raise AnalysisError("master part: all values of the baseline are identical; check whether they were rounded")
    slope, u_slope = _line(when, row)
    p = 2.0 * float(scipy.special.stdtr(row.size - 2, -abs(slope) / u_slope)) if u_slope > 0.0 else float(slope == 0.0)
    reach = sd * math.sqrt(1.0 + 1.0 / baseline) * float(scipy.special.stdtrit(0.62 * (baseline - 1), INSIDE_ONE_SIDE))
    signals = _signals(row, centre, reach)
    if p < 1.0 - level:
        signals.append(Signal("trend", row.size, f"drifts by {slope:.3g} per day: look for what wears or creeps"))
    bias = u_bias = None
    if reference is not None:
        certified, u_certified = reference
        bias = float(row.mean()) - certified
        u_bias = 2.0 * math.hypot(u_certified, float(row.std(ddof=1)) / math.sqrt(row.size))
        if abs(bias) > u_bias:
            signals.append(Signal("bias", row.size, f"off the certified value by {bias:.3g}, U is {u_bias:.3g}"))
    return MasterPart(
        centre=centre,
        low_limit=centre - reach,
        high_limit=centre + reach,
        slope_per_day=slope,
        u_slope_per_day=u_slope,
        p_no_trend=p,
        bias=bias,
        u_bias_expanded=u_bias,
        signals=tuple(signals),
    )


def _line(when: FloatArray, row: FloatArray) -> tuple[float, float]:
    """Return slope and standard uncertainty of the line by ordinary least squares."""
    x, y = when - when.mean(), row - row.mean()
    spread = float(np.square(x).sum())
    slope = float((x * y).sum()) / spread
    return slope, math.sqrt(float(np.square(y - slope * x).sum()) / (row.size - 2) / spread)


def _signals(row: FloatArray, centre: float, reach: float) -> list[Signal]:
    """Return the first place at which each rule is broken."""
    rising, falling = np.diff(row, prepend=row[0]) > 0.0, np.diff(row, prepend=row[0]) < 0.0
    rules: tuple[tuple[str, BoolArray, int, str], ...] = (
        ("limit", np.abs(row - centre) > reach, 1, "outside the control limits: stop and find the cause"),
        ("side", row > centre, SAME_SIDE, f"{SAME_SIDE} in a row above the centre: the level has moved"),
        ("side", row < centre, SAME_SIDE, f"{SAME_SIDE} in a row below the centre: the level has moved"),
        ("steps", rising, RISING_OR_FALLING - 1, f"{RISING_OR_FALLING} rising in a row"),
        ("steps", falling, RISING_OR_FALLING - 1, f"{RISING_OR_FALLING} falling in a row"),
    )
    found = []
    for name, hit, length, text in rules:
        ends = np.flatnonzero(np.convolve(hit.astype(np.int64), np.ones(length, np.int64)) == length)
        if ends.size:
            found.append(Signal(name, int(ends[0]) + 1, text))
    return found
