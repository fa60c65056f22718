"""What `analyze --monte-carlo N` found, for a person: interval and standard uncertainty beside those of the budget."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from station.documents.result import MetricValue, MonteCarlo
from station.errors import StationError
from station.reports.metric_sides import on_side
from station.reports.result_text import metric_name, minus, number, unit_text

LEAST_DRAWS = 50
"""An interval of 95.45 % has one draw in 44 beyond each of its ends."""

MEANS = (
    "Monte Carlo, {draws} draws of all errors at once: its u, and the interval that holds 95.45 % of the draws, "
    "without sensitivities and without k. The U of the budget, k·u with k = 2, is what decides."
)
NONE = "Monte Carlo: no sensor specifications; give the bench file (--bench)"


def check_draws(draws: int) -> None:
    """Refuse a number of draws that shows no interval."""
    if 0 < draws < LEAST_DRAWS:
        raise StationError(
            f"--monte-carlo: found {draws}; allowed: 0 (none), or {LEAST_DRAWS} and more. Fewer draws give "
            "no 95.45 % interval; use 1000"
        )


def show_monte_carlo(console: Console, metrics: Sequence[MetricValue]) -> None:
    """Print every side of every metric that was drawn, and what the columns are."""
    rows = [on_side(metric, side, found) for metric in metrics for side, found in metric.sides.items()]
    drawn = [(row, row.monte_carlo) for row in rows if row.monte_carlo is not None]
    if not drawn:
        console.print(NONE, highlight=False)
        return
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("metric", no_wrap=True)
    for name in ("value", "U", "u", "Monte Carlo u", "interval"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for row, found in drawn:
        table.add_row(*_cells(row, found))
    console.print(table)
    console.print(MEANS.format(draws=drawn[0][1].draws), style="dim", highlight=False)
    left = [metric_name(row) for row in rows if row.monte_carlo is None]
    if left:
        console.print(
            f"Without Monte Carlo, because they have no uncertainty budget: {', '.join(left)}", highlight=False
        )
    console.print()


def _cells(row: MetricValue, found: MonteCarlo) -> list[str]:
    """Return the texts of one row; those of a grade are of the backlash that it is the grade of."""
    u = sum(one.contribution**2 for one in row.budget) ** 0.5
    spread = 2.0 * u
    graded = row.id == "grade"
    return [
        metric_name(row),
        number(row.value, None if graded else spread),
        _two_digits(spread),
        _two_digits(u),
        _two_digits(found.u),
        f"{number(found.low, spread)} … {number(found.high, spread)}",
        "arcmin of backlash" if graded else unit_text(row.unit),
    ]


def _two_digits(value: float) -> str:
    return minus(f"{value:#.2g}".rstrip("."))
