"""`lostmotion metrics`: what each metric means, what can be chosen for it, and which belong to a preset."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import NamedTuple

from rich.padding import Padding
from rich.text import Text

from definitions.metrics import FITS, METRICS
from recipes import PRESETS
from recipes.schema.metric_schema import MetricWanted, preset_metrics
from station.cli.runs.evaluate_anew import known_preset
from station.documents.entries import plain
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
        sys.stdout.write(json.dumps(plain(found), ensure_ascii=False) + "\n")
        return 0
    console = result_console()
    for metric in rows:
        unit = "" if metric.unit == "1" else f"  {metric.unit}"
        console.print(Text.assemble((metric.title, "bold"), (f"  {metric.id}{unit}", "dim")))
        choices = {name: getattr(metric, name) for name in CHOICES}
        lines = [metric.definition, *(f"{name}: {', '.join(chosen)}" for name, chosen in choices.items() if chosen)]
        console.print(Padding(Text("\n".join(lines)), (0, 0, 0, 4)))
    console.print(Text("\nFits of the stiffness curve", style="bold"))
    for name, fit in FITS.items():
        console.print(Padding(Text(f"{name}: {fit.text}"), (0, 0, 0, 4)))
    for name in names:
        shown = _preset(name)
        console.print(Text(f"\npreset {name}", style="bold"))
        lines = [shown.text, f"percentages of: {shown.reference}", f"break torques: {shown.breaks}"]
        console.print(Padding(Text("\n".join([*lines, *shown.metrics])), (0, 0, 0, 4)))
    return 0


class ShownMetric(NamedTuple):
    """A metric; the choices are empty where there is one only."""

    id: str
    symbol: str
    title: str
    unit: str
    definition: str
    source: str
    branches: Sequence[str]
    sides: Sequence[str]
    variants: Sequence[str]
    fits: Sequence[str]
    free: Sequence[str]


class ShownPreset(NamedTuple):
    """A preset: what its percentages are of, its break torques, and its metrics with what is chosen for each."""

    name: str
    text: str
    reference: str
    breaks: str
    metrics: Sequence[str]


CHOICES = ("branches", "sides", "variants", "fits", "free")
"""What can be chosen for a metric."""


def _metrics_of(preset: str | None) -> list[str]:
    return list(METRICS) if preset is None else list(dict.fromkeys(row.id for row in PRESETS[preset].metrics))


def _metric(name: str) -> ShownMetric:
    row = METRICS[name]
    return ShownMetric(
        id=name,
        symbol=row.symbol,
        title=row.title,
        unit=row.unit,
        definition=row.text,
        source=row.source,
        branches=_several(row.branches),
        sides=_several(row.sides),
        variants=_several(row.variants),
        fits=_several(row.fits),
        free=row.free,
    )


def _several(choices: Sequence[str]) -> Sequence[str]:
    return choices if len(choices) > 1 else ()


def _preset(name: str) -> ShownPreset:
    row = PRESETS[name]
    metrics = [metric_text(metric) for metric in preset_metrics(name)]
    return ShownPreset(name, row.text, row.reference, row.breaks, metrics)


def metric_text(metric: MetricWanted) -> str:
    """Return a metric with what is chosen for it, as one line."""
    band = None if metric.band is None else f"band {100.0 * metric.band:g} %"
    return " ".join(part for part in (metric.id, metric.branch, band, metric.variant, metric.fit) if part)
