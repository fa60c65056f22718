"""Uncertainty budgets as rows of text: of every side of every metric, with all that U is computed from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from station.documents.result import BudgetRow, MetricValue
from station.reports.metric_sides import side_rows
from station.reports.result_text import COVERAGE, figure_text, metric_name, number, uncertainty_text, unit_text

BUDGET_HEADS = ("source", "distribution", "u", "sensitivity", "contribution", "share")

LEAST_SHARE = 0.005
"""Contributions below this share of the variance are summed in one line; the page has them all below it."""

DIGITS = 4
"""Digits of the figures: two more than U is printed with, so that U can be computed again from them."""

OF_BACKLASH = "grade"
"""Metric whose budget is that of another quantity: of the backlash that the grade is read off, in arcmin."""

Row = tuple[str, ...]


@dataclass(frozen=True)
class BudgetTable:
    """Uncertainty budget of one side of a metric: rows of `BUDGET_HEADS`.

    rows: the large contributions, then the sum of the small ones and that of all. small: the small ones one by one.
    """

    metric: str
    expanded: str
    rows: tuple[Row, ...]
    small: tuple[Row, ...] = ()


def budget_tables(metrics: Sequence[MetricValue]) -> tuple[BudgetTable, ...]:
    """Return the budget of each side that has one: of each metric the side that judges first."""
    rows = [row for metric in metrics for row in side_rows(metric)]
    return tuple(_table(row) for row in rows if row.budget)


def _table(metric: MetricValue) -> BudgetTable:
    graded = metric.id == OF_BACKLASH
    unit = "arcmin" if graded else metric.unit
    sources = sorted(metric.budget, key=lambda row: -(row.share or 0.0))
    large = [row for row in sources if (row.share or 0.0) >= LEAST_SHARE]
    small = sources[len(large) :]
    table = [_row(row, unit) for row in large]
    if small:
        names = ", ".join(row.quantity.replace("_", " ") for row in small)
        share = sum((row.share or 0.0) for row in small)
        summed = figure_text(_root_sum(small), unit, DIGITS)
        table.append((f"{len(small)} of less than {LEAST_SHARE:.1%} each: {names}", "", "", "", summed, f"{share:.1%}"))
    factor = metric.coverage_factor or COVERAGE
    u = _root_sum(sources)
    expanded = figure_text(factor * u, unit, DIGITS)
    whole = "all (of the backlash)" if graded else "all"
    total = f"{whole}: u = √Σ contribution², U = {factor:g}·u = {expanded}"
    table.append((total, "", "", "", figure_text(u, unit, DIGITS), "100.0%"))
    stated = f"{number(metric.value, metric.uncertainty)} {uncertainty_text(metric)} {unit_text(metric.unit)}"
    return BudgetTable(metric_name(metric), stated.rstrip(), tuple(table), tuple(_row(row, unit) for row in small))


def _row(row: BudgetRow, unit: str) -> Row:
    share = row.share
    return (
        row.text or row.quantity,
        row.distribution or "–",
        figure_text(row.u, row.unit, DIGITS),
        figure_text(row.sensitivity, "", DIGITS),
        figure_text(row.contribution, unit, DIGITS),
        "–" if share is None else f"{share:.1%}" if share >= LEAST_SHARE or share == 0 else f"{share:.1g}",
    )


def _root_sum(rows: Sequence[BudgetRow]) -> float:
    return math.hypot(*(row.contribution for row in rows))
