"""`lostmotion analyze`: metrics of a stored run, or of a CSV, Parquet or TDMS trace measured elsewhere."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from recipes import OWN, Selection
from station.bench.request import trace_file
from station.cli.measure.run import EXIT_BENCH, EXIT_CODES, exit_code
from station.cli.runs.evaluate_anew import elsewhere, known_preset, reevaluate
from station.cli.runs.show import tell_alone
from station.cli.say import Grid, print_grid
from station.documents.entries import plain
from station.documents.result import Evaluation, MetricValue, MonteCarlo, Result
from station.errors import StationError
from station.records.data_folder import Store
from station.records.run_record import INTERRUPTED, NOT_CONCLUDED, RECORDING, RunRecord
from station.records.seal import alterations
from station.reports.metric_sides import on_side
from station.reports.result_text import COVERAGE, metric_name, minus, number, unit_text
from station.reports.result_view import result_console, show_result
from station.reports.stored_result import stored_result
from station.run.conclusion import NOT_DECIDABLE

LEAST_DRAWS = 50
"""An interval of 95.45 % has one draw in 44 beyond each of its ends."""

MEANS = (
    "Monte Carlo, {draws} draws of all errors at once: its u, and the interval that holds 95.45 % of the draws, "
    "without sensitivities and without k. The verdict uses the U of the uncertainty budget, not these values."
)
NONE = "Monte Carlo: no sensor specifications; give the bench file (--bench)"


def analyze(
    trace: str,
    recipe: str | None,
    bench: str | None,
    data: Path,
    *,
    as_json: bool,
    selection: Selection = OWN,
    draws: int = 0,
) -> int:
    """Analyse a trace and print its result; return the exit code of its verdict.

    selection: metrics to report instead of the recipe's; the recipe's limits for the same definitions hold.
    draws: of Monte Carlo beside the uncertainty budget.

    Raises:
        StationError, RecipeError, AnalysisError: what cannot be read, or what the method needs and the trace lacks.

    """
    if selection.preset is not None:
        known_preset(selection.preset)
    check_draws(draws)
    path = trace_file(trace)
    if path is not None:
        if recipe is None:
            raise StationError(f"{trace}: --recipe is missing: it defines how the trace is evaluated")
        result = elsewhere(path, recipe, bench, selection, draws=draws)
    else:
        run = Store(data).find(trace, alone=True)
        tell_alone(run)
        if run.state() != "complete" and not alterations(run):
            return _incomplete(run, as_json=as_json)
        result = reevaluate(run, recipe, bench, selection, draws=draws)
    if as_json:
        sys.stdout.write(json.dumps(plain(result), ensure_ascii=False) + "\n")
        return _code(result)
    console = result_console()
    heading = reevaluation_heading(result)
    if heading:
        console.print(heading, style="bold magenta", highlight=False, soft_wrap=True)
    if draws and result.metrics:
        show_monte_carlo(console, result.metrics)
    show_result(console, result)
    if heading:
        # The verdict is the last thing on the screen: whose it is stands below it as well.
        console.print(heading, style="bold magenta", highlight=False, soft_wrap=True)
    return _code(result)


def _code(result: Result) -> int:
    return EXIT_CODES[NOT_DECIDABLE] if result.altered else exit_code(result)


def _incomplete(run: RunRecord, *, as_json: bool) -> int:
    """Say why a run has no trace to evaluate; return 4 for one that stopped or faulted, 3 for one without an end."""
    state = run.state()
    words = {
        "fault": "the run ended in a fault",
        "stopped": "the run was stopped",
        "interrupted": "the run was interrupted",
        "not concluded": "the run is not concluded",
        "recording": "the run is still going on",
    }
    what = words.get(state, f"the run is {state}")
    sys.stderr.write(f"{run.id}: {what}: it has no complete trace to evaluate. See 'lostmotion show {run.id}'\n")
    if as_json:
        sys.stdout.write(json.dumps(plain(stored_result(run)), ensure_ascii=False) + "\n")
    return EXIT_CODES[NOT_DECIDABLE] if state in (INTERRUPTED, RECORDING, NOT_CONCLUDED) else EXIT_BENCH


def reevaluation_heading(result: Evaluation) -> str:
    """Return what stands above and below the result of another recipe or bench; '' for the run's own."""
    if not result.reevaluated:
        return ""
    recipe, original = result.recipe, result.original_verdict
    with_bench = result.reevaluated_bench
    bench = f" on bench {with_bench}" if with_bench else ""
    selection = f" by the definitions of {', '.join(result.selection)}" if result.selection else ""
    return (
        f"RE-EVALUATED with recipe {recipe.name} revision {recipe.revision} ({recipe.sha256[:8]}){bench}{selection}. "
        f"The run's own verdict was {original}"
    )


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
    heads = ("metric", "value", "U", "u", "Monte Carlo u", "interval", "unit")
    print_grid(console, Grid(heads, [_cells(row, found) for row, found in drawn], right=(1, 2, 3, 4, 5)))
    console.print(MEANS.format(draws=drawn[0][1].draws), style="dim", highlight=False)
    left = [metric_name(row) for row in rows if row.monte_carlo is None]
    if left:
        console.print(
            f"These metrics have no Monte Carlo values, because they have no uncertainty budget: {', '.join(left)}",
            highlight=False,
        )
    console.print()


def _cells(row: MetricValue, found: MonteCarlo) -> list[str]:
    """Return the texts of one row; those of a grade are of the backlash that it is the grade of."""
    u = sum(one.contribution**2 for one in row.budget) ** 0.5
    spread = (row.coverage_factor or COVERAGE) * u
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
