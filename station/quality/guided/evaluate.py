"""The evaluation of a study whose every step is measured: by the functions for any runs, on its own alone."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.line.gage_study import (
    AverageRange,
    GageDesign,
    GageStudy,
    analyse_average_range,
    analyse_gage_study,
    gage_design,
)
from station.counted import counted
from station.documents.study import TYPE_ONE, StudyMetric
from station.errors import StationError
from station.quality.bench_ability import Part, PartSeries, TypeOneFigure, series_of, tolerance_of, type_one_of
from station.quality.guided.progress import Standing
from station.store.quality.lot import Production

MOST_TOLD = 6
"""Rows of what is missing, and of what does not count, that a refusal tells."""


@dataclass(frozen=True)
class GageFigure:
    """A gage study of one metric over the side with the larger share of the gage; others: the studies of the others."""

    metric: str
    side: str
    unit: str
    design: GageDesign
    tolerance: float | None
    anova: GageStudy
    average_range: AverageRange
    others: tuple[tuple[str, GageStudy], ...]


Figure = TypeOneFigure | GageFigure


def refuse_incomplete(standing: Standing) -> None:
    """Refuse to evaluate a study with steps that are not measured.

    Raises:
        StationError: saying which units, operators and trials are missing, what does not count and why, what to do.

    """
    if not standing.open:
        return
    name, steps = standing.study.name, len(standing.plan.order)
    rows = [f"study {name}: {steps - len(standing.open)} of {steps} steps are measured. Missing:"]
    rows += _some(standing.missing())
    refused = [f"step {one.step}, run {one.run} does not count: {one.why}" for one in standing.does_not_count
               if one.step in standing.open]  # fmt: skip
    rows += _some(refused)
    rows.append(f"An incomplete design is not evaluated. 'lostmotion quality study next {name}' says what comes next")
    raise StationError("\n".join(rows))


def _some(rows: list[str]) -> list[str]:
    more = len(rows) - MOST_TOLD
    return [f"  {one}" for one in rows[:MOST_TOLD]] + ([f"  and {more} more"] if more > 0 else [])


def evaluate(production: Production, standing: Standing, level: float = 0.95) -> tuple[Figure, ...]:
    """Return the figures of each metric of a study.

    Raises:
        StationError: steps are missing, or runs are not in the store. AnalysisError: the values allow no study.

    """
    refuse_incomplete(standing)
    of_kind = _type_one if standing.plan.kind == TYPE_ONE else _gage
    return tuple(of_kind(production, standing, metric, level) for metric in standing.plan.metrics)


def _part(standing: Standing, serial: str, metric: str) -> Part:
    plan = standing.plan
    runs = tuple(run for step, run in sorted(standing.measured.items()) if plan.order[step - 1].part == serial)
    return Part(serial, metric, bench=plan.bench, virtual=plan.virtual, runs=runs)


def _type_one(production: Production, standing: Standing, metric: StudyMetric, level: float) -> Figure:
    part, share = _part(standing, standing.plan.parts[0], metric.id), standing.plan.share / 100.0
    for one in series_of(production, part):
        _refuse_absent(standing, part, one)
    return type_one_of(production, part, float(metric.reference or 0.0), metric.tolerance, share, level)


def _gage(production: Production, standing: Standing, metric: StudyMetric, level: float) -> Figure:
    by_side: dict[str, dict[str, float]] = {}
    first: PartSeries | None = None
    for serial in standing.plan.parts:
        part = _part(standing, serial, metric.id)
        for one in series_of(production, part):
            _refuse_absent(standing, part, one)
            by_side.setdefault(one.side, {}).update(zip(one.runs, one.values, strict=True))
            first = first or one
    assert first is not None  # noqa: S101 - for the type checker: a plan has parts, and `series_of` returns a side
    tolerance = metric.tolerance
    if tolerance is None:
        try:
            tolerance, _ = tolerance_of(production, first)
        except StationError:
            tolerance = None  # of a metric with one limit: the share of the total spread is told alone
    found = []
    for side, values in by_side.items():
        cells = [(standing.plan.order[step - 1], values[run]) for step, run in sorted(standing.measured.items())]
        design = gage_design(
            [cell.operator for cell, _ in cells], [cell.part for cell, _ in cells], [value for _, value in cells]
        )
        found.append((analyse_gage_study(design, tolerance, level), design, side))
    found.sort(key=lambda one: -one[0].worse_pct)
    anova, design, side = found[0]
    others = tuple((name, other) for other, _, name in found[1:])
    ranges = analyse_average_range(design, tolerance, level)
    return GageFigure(metric.id, side, first.metric.unit, design, tolerance, anova, ranges, others)


def _refuse_absent(standing: Standing, part: Part, found: PartSeries) -> None:
    """Refuse a series without some of the runs of the study: a figure of fewer runs is another study."""
    absent = sorted(set(part.runs or ()) - set(found.runs))
    if absent:
        raise StationError(
            f"study {standing.study.name}: the store of runs has no value of {part.metric}, side {found.side}, for "
            f"{counted(len(absent), 'run')}, such as {absent[0]}. Read the runs again with 'lostmotion store rebuild'"
        )
