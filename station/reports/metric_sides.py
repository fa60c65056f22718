"""The sides of a metric as rows of a table, the one that judges first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf

from station.documents.result import MetricValue, SideValue

SEVERITY = {"FAIL": 0, "NOT DECIDABLE": 1, "PASS": 2}


def side_rows(metric: MetricValue) -> list[MetricValue]:
    """Return a metric as one row per side, the one that judges first."""
    headline = metric.sides.get(metric.side, metric)
    rows = [replace(metric, verdict=headline.verdict)]
    rows += [on_side(metric, side, found) for side, found in metric.sides.items() if side != metric.side]
    return sorted(rows, key=_goodness)


def on_side(metric: MetricValue, side: str, found: SideValue) -> MetricValue:
    """Return a metric with what it has on another of its sides."""
    return replace(
        metric,
        side=side,
        value=found.value,
        uncertainty=found.uncertainty,
        verdict=found.verdict,
        budget=found.budget,
        monte_carlo=found.monte_carlo,
        standard_deviation=found.standard_deviation,
        per_cycle=found.per_cycle,
    )


def _goodness(row: MetricValue) -> tuple[int, float]:
    """Order rows by how near they are to refusal: verdict first, then the distance to the nearest limit."""
    value, low, high = row.value, row.limits.min, row.limits.max
    if value is None:
        return SEVERITY.get(row.verdict or "", len(SEVERITY)), -inf
    room = min(inf if low is None else value - low, inf if high is None else high - value)
    return SEVERITY.get(row.verdict or "", len(SEVERITY)), room


def all_rows(metrics: Sequence[MetricValue]) -> list[MetricValue]:
    """Return the metrics as rows, every side of each; of the sides the one that judges first."""
    return [row for metric in metrics for row in side_rows(metric)]


def worst_first(metrics: Sequence[MetricValue]) -> list[MetricValue]:
    """Return every side of every metric: those that failed, those that were not decided, passed, and reported ones."""
    return sorted(all_rows(metrics), key=lambda row: SEVERITY.get(row.verdict or "", len(SEVERITY)))


def judging_rows(metrics: Sequence[MetricValue]) -> list[MetricValue]:
    """Return one row per metric: the side that is nearest to refusal, or beyond it."""
    return [side_rows(metric)[0] for metric in metrics]
