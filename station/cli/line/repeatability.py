"""`lostmotion repeatability`: how far every metric spreads over the cycles and over repeated runs of one unit."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.table import Table
from rich.text import Text

from analysis.line.spread import LEAST_RUNS, Repeatability, repeatability
from recipes import Selection
from station.cli.runs.evaluate_anew import elsewhere, known_preset, reevaluate
from station.cli.say import Grid, print_grid
from station.counted import counted
from station.documents.entries import plain
from station.documents.result import Evaluation, MetricValue
from station.errors import StationError
from station.records.data_folder import Store
from station.reports.result_text import metric_name, number, unit_text
from station.reports.result_view import definition_text, result_console


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricSpread:
    """One side of a metric and how far it spreads; None where a run lacks the value."""

    id: str
    definition: str
    unit: str
    branch: str
    estimator: str
    band: float | None
    torque_nm: float | None
    choices: tuple[str, ...]
    cycles: int | None
    side: str
    repeatability: Repeatability | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeated:
    """Every metric over the runs of a unit."""

    runs: tuple[str, ...]
    serial: str | None
    preset: str | None
    selection: tuple[str, ...]
    metrics: tuple[MetricSpread, ...]


def repeat(names: list[str], recipe: str | None, selection: Selection, data: Path, *, as_json: bool) -> int:
    """Print mean and standard deviations of each metric over several runs of a unit.

    names: stored runs or traces; a serial number alone stands for all of its complete runs. selection: metrics to
    compare instead of the recipe's.

    Raises:
        StationError, RecipeError, AnalysisError: what cannot be read, or not be compared.

    """
    if selection.preset is not None:
        known_preset(selection.preset)
    results = [_result(name, recipe, selection, data) for name in _all_of(names, data)]
    _same_unit(results)
    found = Repeated(
        runs=tuple(_source(result) for result in results),
        serial=results[0].serial,
        preset=selection.preset,
        selection=tuple(selection.parts),
        metrics=tuple(_spreads(results)),
    )
    if as_json:
        sys.stdout.write(json.dumps(plain(found), ensure_ascii=False) + "\n")
        return 0
    console = result_console()
    console.print(f"{counted(len(results), 'run')}: {', '.join(found.runs)}", highlight=False, soft_wrap=True)
    print_grid(console, _spread_grid(found.metrics))
    console.print()
    console.print(_definitions(results[0].metrics))
    return 0


def _all_of(names: list[str], data: Path) -> list[str]:
    """Return the runs that are meant, each once; AnalysisError or StationError when there are too few."""
    if len(names) == 1 and not Path(names[0]).exists():
        named = [run for run in Store(data).of_serial(names[0]) if run.state() == "complete"]
        names = [run.id for run in named] or names
    names = list(dict.fromkeys(names))
    if len(names) < LEAST_RUNS:
        raise StationError(
            f"{names[0]}: found {len(names)} complete run; expected {LEAST_RUNS} or more of one unit. "
            "Name the runs, or a serial number that was measured more than once",
        )
    return names


def _result(name: str, recipe: str | None, selection: Selection, data: Path) -> Evaluation:
    path = Path(name)
    if path.is_file():
        if recipe is None:
            raise StationError(f"file {name}: --recipe is missing. Name the recipe that says how the file is evaluated")
        return elsewhere(path, recipe, None, selection)
    run = Store(data).find(name)
    if run.state() != "complete":
        raise StationError(f"run {run.id} is {run.state()}; expected complete runs. Leave this run out")
    result = reevaluate(run, recipe, None, selection)
    if result.altered:
        raise StationError(f"run {run.id}: the record was altered and cannot be used. Leave this run out")
    return result


def _same_unit(results: Sequence[Evaluation]) -> None:
    serials = list(dict.fromkeys(str(result.serial) for result in results))
    if len(serials) > 1:
        raise StationError(
            f"the runs have the serial numbers {', '.join(serials)}; repeatability needs runs of one unit. Name runs "
            "of one serial number",
        )
    for result in results[1:]:
        for one, other in zip(results[0].metrics, result.metrics, strict=False):
            if _is(one) != _is(other) or len(results[0].metrics) != len(result.metrics):
                raise StationError(
                    f"runs {results[0].run} and {_source(result)} were evaluated by different definitions: "
                    f"{metric_name(one)} and {metric_name(other)}. Choose one definition with --recipe, --preset or "
                    "--metric",
                )


def _source(result: Evaluation) -> str:
    return str(result.run or result.record)


def _is(metric: MetricValue) -> tuple[object, ...]:
    """Return what two numbers must share to be the same metric."""
    kind = (metric.id, metric.branch, metric.estimator, metric.band, metric.torque_nm)
    return (*kind, metric.choices, metric.unit, metric.side)


def _spreads(results: Sequence[Evaluation]) -> list[MetricSpread]:
    """Return every side of every metric with its spread; without one where a run lacks the value."""
    found = []
    for number_of, metric in enumerate(results[0].metrics):
        for side in metric.sides:
            runs = [list(result.metrics[number_of].sides[side].per_cycle) for result in results]
            found.append(
                MetricSpread(
                    id=metric.id,
                    definition=metric.definition,
                    unit=metric.unit,
                    branch=metric.branch,
                    estimator=metric.estimator,
                    band=metric.band,
                    torque_nm=metric.torque_nm,
                    choices=metric.choices,
                    cycles=metric.cycles,
                    side=side,
                    repeatability=repeatability(runs) if all(runs) else None,
                )
            )
    return found


def _spread_grid(metrics: Sequence[MetricSpread]) -> Grid:
    rows = []
    for metric in metrics:
        one = metric.repeatability
        figures = (None,) * 4 if one is None else (one.mean, one.sd_runs, one.sd_cycles, one.sd_between)
        rows.append((metric_name(metric), *map(number, figures), unit_text(metric.unit)))
    return Grid(("metric", "mean", "sd over runs", "sd over cycles", "between runs", "unit"), rows, right=(1, 2, 3, 4))


def _definitions(metrics: Sequence[MetricValue]) -> Table:
    """Return what each metric is, once for all of its sides."""
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    table.add_column(ratio=1)
    texts = {metric_name(replace(metric, side="both")): definition_text(metric) for metric in metrics}
    for name, text in texts.items():
        table.add_row(Text.assemble(f"{name}: ", (text, "dim")))
    return table
