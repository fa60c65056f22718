"""Yield, causes, capability, control chart and trend of a lot: from the store through the statistics of a line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from analysis.line.capability import Capability, capability
from analysis.line.chart_run_length import chart_run_length
from analysis.line.control_chart import ControlChart, control_chart
from analysis.line.groups import GroupsCompared, compare_groups
from analysis.line.proportions import Cause, Proportion, pareto, proportion
from analysis.line.run_rules import RunLength
from analysis.trace.errors import AnalysisError
from station.counted import counted
from station.documents.result import Limits
from station.errors import StationError
from station.reports.result_text import limits_text, unit_text
from station.store.quality.counts import LotYield, alarms, failures, first_verdicts, sum_of, undecided, yields
from station.store.quality.lot import Lot, Production
from station.store.quality.values import (
    Characteristic,
    TestedBy,
    characteristic,
    characteristics,
    other_meanings,
    sums,
    tested_by,
    values,
)

SHIFT_SIGMAS = 1.0
"""Shift of the process, in standard deviations of what is plotted, for which a chart's delay is told."""

WHOLE = "whole lot"


@dataclass(frozen=True, slots=True)
class YieldRow:
    """Yield of a group: verdicts of first attempts and of units by their newest run, and the shares that passed."""

    group: str
    verdicts: LotYield
    first_pass: Proportion
    final: Proportion


@dataclass(frozen=True, slots=True)
class YieldFigure:
    """Yields of a lot: of all of it, and of each group where a grouping was asked for."""

    lot: Lot
    by: str | None
    whole: YieldRow
    groups: tuple[YieldRow, ...]


def left_out_of(production: Production, lot: Lot, serial: str | None = None) -> list[str]:
    """Return what a reader must know of runs that no figure of a lot counts: a line for each reason, none for none.

    serial: of one unit; None: all.
    """
    why = "altered since they were sealed, or signed by a key that this computer does not know"
    reasons = (
        ("not in the store yet, and not counted", production.behind, ""),
        (
            "not believed, and not counted",
            production.disbelieved(lot, serial),
            f" ({why}); 'lostmotion verify' names them",
        ),
    )
    return [f"{what}: {counted(number, 'run')}{more}" for what, number, more in reasons if number]


def yield_of(production: Production, lot: Lot, by: str | None = None, level: float = 0.95) -> YieldFigure:
    """Return first-pass and final yield; StationError for a lot without runs."""
    production.refuse_empty(lot)
    groups = yields(production, lot, by)
    whole = LotYield(*(sum_of(parts) for parts in zip(*groups.values(), strict=True)))
    rows = () if by is None else tuple(_yield_row(name, one, level) for name, one in groups.items())
    return YieldFigure(lot, by, _yield_row(WHOLE, whole, level), rows)


def _yield_row(name: str, one: LotYield, level: float) -> YieldRow:
    first, final = (proportion(part.passed, part.units, level) for part in (one.first, one.final))
    return YieldRow(name, one, first, final)


@dataclass(frozen=True, slots=True)
class CausesFigure:
    """Causes of a lot, commonest first: metrics that failed, alarms, and why runs have no verdict."""

    lot: Lot
    first_attempts: int
    failed: tuple[Cause, ...]
    alarms: tuple[Cause, ...]
    undecided: tuple[Cause, ...]


def causes_of(production: Production, lot: Lot) -> CausesFigure:
    """Return what hindered a lot; StationError for one without runs."""
    production.refuse_empty(lot)
    failed = {one.name: number for one, number in failures(production, lot).items()}
    return CausesFigure(
        lot,
        first_verdicts(production, lot).units,
        pareto(failed),
        pareto(alarms(production, lot)),
        pareto(undecided(production, lot)),
    )


@dataclass(frozen=True, slots=True)
class CapabilityRow:
    """Capability of a metric over the side that judges; `why` says why there is none. others: the other sides' Ppk.

    tested_by: by which limits the values were judged when they were measured; the indices are by those of `metric`.
    without: sides that have no indices, and why, where another side has some: nothing is known of them.
    """

    metric: Characteristic
    side: str
    found: Capability | None
    others: tuple[tuple[str, float], ...] = ()
    other_meanings: int = 0
    why: str = ""
    tested_by: tuple[TestedBy, ...] = ()
    without: tuple[tuple[str, str], ...] = ()

    @property
    def by_others(self) -> tuple[TestedBy, ...]:
        """Return the limits by which values were judged that are not those of the indices."""
        there = (self.metric.limit_min, self.metric.limit_max)
        return tuple(one for one in self.tested_by if (one.limit_min, one.limit_max) != there)


@dataclass(frozen=True, slots=True)
class CapabilityFigure:
    """Capability of every metric of a lot that has a limit."""

    lot: Lot
    subgroup: int
    level: float
    rows: tuple[CapabilityRow, ...]


def capability_of(
    production: Production,
    lot: Lot,
    names: Sequence[str] = (),
    *,
    subgroup: int = 1,
    level: float = 0.95,
    limits: Limits | None = None,
) -> CapabilityFigure:
    """Return the capability of metrics, by default of all that have a limit in the newest run of the lot.

    limits: instead of those of the newest run, for the one metric that is named. Raises StationError for a lot without
    valid runs, a metric that it does not have, or no limit at all.
    """
    lot = production.one_recipe(lot)
    if names:
        chosen = [characteristic(production, lot, name) for name in names]
    else:
        chosen = [one for one in characteristics(production, lot) if one.limited]
    if limits is not None:
        if len(chosen) != 1:
            raise StationError("--min and --max change the limits of one metric. Name this metric with --metric")
        chosen = [chosen[0]._replace(limit_min=limits.min, limit_max=limits.max)]
    without = [one.name for one in chosen if not one.limited]
    if without or not chosen:
        what = f"no limit for {', '.join(without)}" if without else "no metric of the newest run has a limit"
        raise StationError(f"capability needs a limit, but found {what}. Give --min X, --max X or both")
    rows = tuple(_capability_row(production, lot, one, subgroup, level) for one in chosen)
    return CapabilityFigure(lot, subgroup, level, rows)


def _capability_row(
    production: Production, lot: Lot, what: Characteristic, subgroup: int, level: float
) -> CapabilityRow:
    sides: dict[str, Capability] = {}
    without: dict[str, str] = {}
    for side in what.sides:
        try:
            row = values(production, lot, what, side)
            sides[side] = capability([one.value for one in row], what.limit_min, what.limit_max, subgroup, level)
        except AnalysisError as error:
            without[side] = str(error)
    different = other_meanings(production, lot, what)
    if not sides:
        by = tested_by(production, lot, what, what.sides[0])
        return CapabilityRow(what, what.sides[0], None, (), different, without[what.sides[0]], by)
    judging = min(sides, key=lambda side: sides[side].overall.nearest)
    others = tuple((side, one.overall.nearest) for side, one in sides.items() if side != judging)
    by = tested_by(production, lot, what, judging)
    return CapabilityRow(what, judging, sides[judging], others, different, "", by, tuple(without.items()))


def said_beside(row: CapabilityRow, name: str) -> list[str]:
    """Return what a reader must know of the indices: which side has none, and by which limits others were tested.

    name: of the metric, '' for none.
    """
    begin = f"{name}: " if name else ""
    none = [f"{begin}nothing is known of side {side}, which has no index. {why}" for side, why in row.without]
    return none + tested_by_others(row, name)


def tested_by_others(row: CapabilityRow, name: str) -> list[str]:
    """Return by which limits values were tested that the indices are not by; name: of the metric, '' for none."""
    begin = f"{name}: " if name else ""
    of, unit, said = sum(one.number for one in row.tested_by), unit_text(row.metric.unit), list[str]()
    for one in row.by_others:
        limits = f"{limits_text(Limits(min=one.limit_min, max=one.limit_max))} {unit}".strip()
        limits = "no limit" if one.limit_min is None and one.limit_max is None else limits
        revisions = f" (recipe revision {', '.join(map(str, one.revisions))})" if one.revisions else ""
        were = "was" if one.number == 1 else "were"
        said.append(f"{begin}{one.number} of {counted(of, 'value')} {were} tested by {limits}{revisions}")
    return said


def judging_side(production: Production, lot: Lot, what: Characteristic, side: str | None) -> str:
    """Return the side that is asked for, or else the one nearer to the limits; StationError for one it does not have.

    Nearer is the one with the smaller Ppk; of a metric without limits it is the first.
    """
    if side is not None:
        if side not in what.sides:
            raise StationError(f"--side: found '{side:.20}'; {what.name} has {' and '.join(what.sides)}")
        return side
    if len(what.sides) == 1 or not what.limited:
        return what.sides[0]
    return min(what.sides, key=lambda one: _nearest(production, lot, what, one))


def _nearest(production: Production, lot: Lot, what: Characteristic, side: str) -> float:
    """Return the Ppk of a side; infinite where it has none."""
    row = [one.value for one in values(production, lot, what, side)]
    try:
        return capability(row, what.limit_min, what.limit_max).overall.nearest
    except AnalysisError:
        return math.inf


@dataclass(frozen=True, slots=True)
class ChartFigure:
    """Control chart of a metric.

    run_length: points until a false alarm, on average, by the rules of the means and the limits of the spreads
    together; shifted: points until both together find a shift of one standard deviation of what is plotted. runs: the
    last run of each subgroup.
    """

    lot: Lot
    metric: Characteristic
    side: str
    rules: tuple[str, ...]
    chart: ControlChart
    run_length: RunLength
    shifted: RunLength
    runs: tuple[str, ...]
    started: tuple[str, ...]
    other_meanings: int

    def false_alarms_per_hour(self, units_per_hour: float, metrics: int = 1) -> float:
        """Return how many false alarms an hour brings with so many metrics charted by these rules."""
        return metrics * units_per_hour / self.chart.subgroup / self.run_length.points


def chart_of(
    production: Production,
    lot: Lot,
    name: str,
    rules: tuple[str, ...],
    *,
    side: str | None = None,
    branch: str | None = None,
    subgroup: int = 5,
    baseline: int | None = None,
) -> ChartFigure:
    """Return the chart of a metric over the first attempts of a lot, in the order of production.

    Raises StationError and AnalysisError as `characteristic` and
    `control_chart`.
    """
    lot = production.one_recipe(lot)
    what = characteristic(production, lot, name, branch)
    judging = judging_side(production, lot, what, side)
    rows = values(production, lot, what, judging)
    chart = control_chart([row.value for row in rows], subgroup, rules, baseline=baseline)
    last = rows[subgroup - 1 : len(chart.means) * subgroup : subgroup]
    return ChartFigure(
        lot,
        what,
        judging,
        rules,
        chart,
        chart_run_length(rules, chart.kind, subgroup),
        chart_run_length(rules, chart.kind, subgroup, SHIFT_SIGMAS),
        tuple(row.run for row in last),
        tuple(row.started for row in last),
        other_meanings(production, lot, what),
    )


@dataclass(frozen=True, slots=True)
class TrendFigure:
    """A metric by groups of runs."""

    lot: Lot
    metric: Characteristic
    side: str
    by: str
    compared: GroupsCompared
    other_meanings: int


def trend_of(
    production: Production,
    lot: Lot,
    name: str,
    by: str,
    *,
    side: str | None = None,
    branch: str | None = None,
    level: float = 0.95,
) -> TrendFigure:
    """Return a metric by bench, shift, operator, day, ...; raises as `characteristic` and `compare_groups`."""
    lot = production.one_recipe(lot)
    what = characteristic(production, lot, name, branch)
    judging = judging_side(production, lot, what, side)
    origin = _origin(production, lot, what, judging)
    found = sums(production, lot, what, judging, by, origin)
    compared = compare_groups(found, origin, level)
    return TrendFigure(lot, what, judging, by, compared, other_meanings(production, lot, what))


def _origin(production: Production, lot: Lot, what: Characteristic, side: str) -> float:
    """Return a value of the lot, which is near the mean of all as far as rounding is concerned."""
    newest = values(production, lot._replace(newest=1), what, side)
    if not newest:
        raise StationError(
            f"{what.name}, side {side}: no first attempt of a unit in the chosen lot has a value of this metric. "
            "Choose the other side, or other runs"
        )
    return newest[0].value
