"""`lostmotion metrics`: what each metric means, what can be chosen for it, and which belong to a preset."""

from __future__ import annotations

import json
import sys
from typing import Any

from rich.padding import Padding
from rich.text import Text

from definitions.metrics import FITS, METRICS
from recipes import PRESETS
from recipes.schema.metric_schema import MetricWanted, preset_metrics
from station.cli.runs.evaluate_anew import known_preset
from station.reports.result_view import result_console


def metrics(preset: str | None, *, as_json: bool) -> int:
    """Print the definitions of all metrics, or of one preset; StationError for one that does not exist."""
    if preset is not None:
        known_preset(preset)
    names = list(PRESETS) if preset is None else [preset]
    rows = [_metric(name) for name in _metrics_of(preset)]
    if as_json:
        fits = {name: {"text": fit.text, "source": fit.source} for name, fit in FITS.items()}
        found = {"metrics": rows, "fits": fits, "presets": [_preset(name) for name in names]}
        sys.stdout.write(json.dumps(found, ensure_ascii=False) + "\n")
        return 0
    console = result_console()
    for metric in rows:
        unit = "" if metric["unit"] == "1" else f"  {metric['unit']}"
        console.print(Text.assemble((metric["title"], "bold"), (f"  {metric['id']}{unit}", "dim")))
        lines = [metric["definition"], *(f"{name}: {', '.join(metric[name])}" for name in CHOICES if metric[name])]
        console.print(Padding(Text("\n".join(lines)), (0, 0, 0, 4)))
    console.print(Text("\nFits of the stiffness curve", style="bold"))
    for name, fit in FITS.items():
        console.print(Padding(Text(f"{name}: {fit.text}"), (0, 0, 0, 4)))
    for name in names:
        shown = _preset(name)
        console.print(Text(f"\npreset {name}", style="bold"))
        lines = [shown["text"], f"percentages of: {shown['reference']}", f"break torques: {shown['breaks']}"]
        console.print(Padding(Text("\n".join([*lines, *shown["metrics"]])), (0, 0, 0, 4)))
    return 0


CHOICES = ("branches", "sides", "variants", "fits", "free")
"""What can be chosen for a metric, by the names of the JSON object."""


def _metrics_of(preset: str | None) -> list[str]:
    return list(METRICS) if preset is None else list(dict.fromkeys(row.id for row in PRESETS[preset].metrics))


def _metric(name: str) -> dict[str, Any]:
    row = METRICS[name]
    several = {
        "branches": row.branches,
        "sides": row.sides,
        "variants": row.variants,
        "fits": row.fits,
    }
    return {
        "id": name,
        "symbol": row.symbol,
        "title": row.title,
        "unit": row.unit,
        "definition": row.text,
        "source": row.source,
        **{key: list(choices) if len(choices) > 1 else [] for key, choices in several.items()},
        "free": list(row.free),
    }


def _preset(name: str) -> dict[str, Any]:
    row = PRESETS[name]
    return {
        "name": name,
        "text": row.text,
        "reference": row.reference,
        "breaks": row.breaks,
        "metrics": [metric_text(metric) for metric in preset_metrics(name)],
    }


def metric_text(metric: MetricWanted) -> str:
    """Return a metric with what is chosen for it, as one line."""
    band = None if metric.band is None else f"band {100.0 * metric.band:g} %"
    return " ".join(part for part in (metric.id, metric.branch, band, metric.variant, metric.fit) if part)
