"""From values and limits to PASS, FAIL or NOT DECIDABLE, with the reason in plain words.

Guard band after JCGM 106: limits are moved in by w = r·U to accept and out by w to reject; between is not decidable.
What is missing or not a number never passes. An invalid measurement decides nothing, whatever the numbers say.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import StrEnum

from analysis.loop.method import Decision
from analysis.trace.errors import AnalysisError


class Verdict(StrEnum):
    """Outcome of a metric and of a run."""

    PASS = "PASS"  # noqa: S105 - a verdict
    FAIL = "FAIL"
    NOT_DECIDABLE = "NOT DECIDABLE"


WORST_FIRST = (Verdict.FAIL, Verdict.NOT_DECIDABLE, Verdict.PASS)
"""A part that misses one limit for certain is bad, even when another metric could not be decided."""


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the worst of several verdicts; nothing decided is NOT DECIDABLE."""
    found = set(verdicts)
    return next((verdict for verdict in WORST_FIRST if verdict in found), Verdict.NOT_DECIDABLE)


def judge(
    value: float | None, uncertainty: float | None, limits: tuple[float | None, float | None], decision: Decision
) -> tuple[Verdict, str]:
    """Judge a value against (min, max); return the verdict and which limit decided ("min", "max", "").

    None or a value that is not finite is NOT DECIDABLE, and so is a guard band without uncertainty.
    """
    if value is None or not math.isfinite(value):
        return Verdict.NOT_DECIDABLE, ""
    guard = 0.0
    if decision.rule == "guard_band":
        if uncertainty is None or not math.isfinite(uncertainty):
            return Verdict.NOT_DECIDABLE, "uncertainty"
        guard = decision.guard_factor * uncertainty
    low, high = limits
    excess = {
        "min": -math.inf if low is None else low - value,
        "max": -math.inf if high is None else value - high,
    }
    limit = max(excess, key=lambda name: excess[name])
    if not any(math.isfinite(amount) for amount in excess.values()):
        return Verdict.PASS, ""
    if excess[limit] <= -guard:
        return Verdict.PASS, limit
    if excess[limit] > guard:
        return Verdict.FAIL, limit
    return Verdict.NOT_DECIDABLE, limit


def judge_spread(standard_deviation: float | None, limit: float) -> Verdict:
    """Judge a standard deviation over cycles; NOT DECIDABLE where there are not two of them.

    It is the sample's own: no guard band, for with few cycles its interval is wider than any useful limit.
    """
    if standard_deviation is None or not math.isfinite(standard_deviation):
        return Verdict.NOT_DECIDABLE
    return Verdict.PASS if standard_deviation <= limit else Verdict.FAIL


def check_limits(name: str, low: float | None, high: float | None) -> None:
    """Refuse limits that are not finite or that exclude each other; AnalysisError names the metric."""
    for which, limit in (("min", low), ("max", high)):
        if limit is not None and not math.isfinite(limit):
            raise AnalysisError(f"metric {name}: {which}: found {limit}; expected a finite number, or no limit")
    if low is not None and high is not None and low > high:
        raise AnalysisError(f"metric {name}: min {low:g} is above max {high:g}; exchange min and max")
