"""`lostmotion repeatability`: how far every metric spreads over the cycles and over repeated runs of one unit."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from analysis.line.spread import LEAST_RUNS, repeatability
from recipes import Selection
from station.cli.runs.evaluate_anew import elsewhere, known_preset, reevaluate
from station.errors import StationError
from station.records.data_folder import Store
from station.reports.result_text import metric_name, number, unit_text
from station.reports.result_view import definition_text, result_console


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
    found = {
        "runs": [result["run"] or result["record"] for result in results],
        "serial": results[0]["serial"],
        "preset": selection.preset,
        "selection": selection.parts,
        "metrics": _spreads(results),
    }
    if as_json:
        sys.stdout.write(json.dumps(found, ensure_ascii=False) + "\n")
        return 0
    console = result_console()
    console.print(f"{len(results)} runs: {', '.join(map(str, found['runs']))}", highlight=False, soft_wrap=True)
    console.print(_table(found["metrics"]))
    console.print()
    console.print(_definitions(found["metrics"]))
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


def _result(name: str, recipe: str | None, selection: Selection, data: Path) -> dict[str, Any]:
    path = Path(name)
    if path.is_file():
        if recipe is None:
            raise StationError(f"{name}: --recipe is missing: it defines how the trace is evaluated")
        return elsewhere(path, recipe, None, selection)
    run = Store(data).find(name)
    if run.state() != "complete":
        raise StationError(f"{run.id}: the run is {run.state()}; expected complete runs. Leave it out")
    result = reevaluate(run, recipe, None, selection)
    if result.get("altered"):
        raise StationError(f"{run.id}: the record was altered and cannot be used. Leave it out")
    return result


def _same_unit(results: list[dict[str, Any]]) -> None:
    serials = list(dict.fromkeys(str(result["serial"]) for result in results))
    if len(serials) > 1:
        raise StationError(
            f"serial numbers {', '.join(serials)}: repeatability is of one unit. Name runs of one serial number",
        )
    for result in results[1:]:
        for one, other in zip(results[0]["metrics"], result["metrics"], strict=False):
            if _is(one) != _is(other) or len(results[0]["metrics"]) != len(result["metrics"]):
                raise StationError(
                    f"{result['run'] or result['record']}: {metric_name(other)} where {results[0]['run']} has "
                    f"{metric_name(one)}: evaluated by different definitions. Name one with --recipe, --preset or "
                    "--metric",
                )


def _is(metric: dict[str, Any]) -> tuple[object, ...]:
    """Return what two numbers must share to be the same metric."""
    return tuple(
        str(metric[key]) for key in ("id", "branch", "estimator", "band", "torque_nm", "choices", "unit", "side")
    )


def _spreads(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return every side of every metric with its spread; without one where a run lacks the value."""
    found = []
    for number_of, metric in enumerate(results[0]["metrics"]):
        for side in metric["sides"]:
            runs = [result["metrics"][number_of]["sides"][side]["per_cycle"] for result in results]
            spread = repeatability(runs)._asdict() if all(runs) else None
            kept = ("id", "definition", "unit", "branch", "estimator", "band", "torque_nm", "choices", "cycles")
            found.append({**{key: metric[key] for key in kept}, "side": side, "repeatability": spread})
    return found


def _table(metrics: list[dict[str, Any]]) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("metric", no_wrap=True)
    for name in ("mean", "sd over runs", "sd over cycles", "between runs"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for metric in metrics:
        spread = metric["repeatability"] or {}
        numbers = [number(spread.get(key)) for key in ("mean", "sd_runs", "sd_cycles", "sd_between")]
        table.add_row(metric_name(metric), *numbers, unit_text(metric["unit"]))
    return table


def _definitions(metrics: list[dict[str, Any]]) -> Table:
    """Return what each metric is, once for all of its sides."""
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    table.add_column(ratio=1)
    texts = {metric_name({**metric, "side": "both"}): definition_text(metric) for metric in metrics}
    for name, text in texts.items():
        table.add_row(Text.assemble(f"{name}: ", (text, "dim")))
    return table
