"""Values of one metric over the first attempts of a lot, and the sums of them by group, which the database forms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, Subquery, func, select

from analysis.line.groups import Sums
from analysis.metrics.former_wordings import wording_of_today
from station.errors import StationError
from station.store.plant.hours import whole_hours
from station.store.plant.meanings import WORDED, Meaning, meaning_of_metrics, meanings_of, numbers_of
from station.store.quality.counts import Grouping, grouping
from station.store.quality.lot import Lot, Production
from station.store.tables import MEANINGS, METRIC_HOURS, METRICS, RUNS


class Characteristic(NamedTuple):
    """A metric as a recipe asks for it, with its limits in the newest run; the names are those of the columns.

    sides: those that it has, the one that judged the newest run first; `both` for a metric without sides.
    """

    metric: str
    choices: str
    branch: str
    definition: str
    estimator: str
    band: str
    torque_nm: str
    unit: str
    limit_min: float | None
    limit_max: float | None
    sides: tuple[str, ...]

    @property
    def name(self) -> str:
        """Return how it is called and asked for."""
        return " ".join(part for part in (self.metric, self.choices) if part)

    @property
    def meaning(self) -> Meaning:
        """Return what it means, without limits and sides."""
        return Meaning(*(getattr(self, name) for name in Meaning._fields))

    @property
    def limited(self) -> bool:
        """Whether it has a limit."""
        return self.limit_min is not None or self.limit_max is not None


class ValueRow(NamedTuple):
    """A value with the run it came from; coverage_factor: the k of its U = k·u, None where the result names none."""

    run: str
    serial: str
    started: str
    bench: str
    value: float
    uncertainty: float | None
    coverage_factor: float | None = None


def newest_run(production: Production, lot: Lot) -> str:
    """Return the newest valid first attempt of a lot; StationError where there is none."""
    production.refuse_empty(lot)
    run = production.connection.execute(select(production.chosen(lot, RUNS.c.valid, newest=1).c.run)).scalar()
    if run is None:
        raise StationError(
            f"{production.chain.data}: no run of the chosen lot is a first attempt with a valid result. Choose other "
            "runs, or measure units first"
        )
    return str(run)


def characteristics(production: Production, lot: Lot) -> tuple[Characteristic, ...]:
    """Return the metrics of the newest run of a lot, in the order of its recipe; StationError as `newest_run`."""
    return metrics_of_run(production, newest_run(production, lot))


def metrics_of_run(production: Production, run: str) -> tuple[Characteristic, ...]:
    """Return the metrics of a run, in the order of its recipe."""
    columns = (*(METRICS.c[name] for name in ("position", "limit_min", "limit_max", "side")), *MEANINGS.c)
    asked = select(*columns).select_from(METRICS).join(MEANINGS, meaning_of_metrics())
    asked = asked.where(METRICS.c.chain == production.chain.id, METRICS.c.run == run)
    asked = asked.order_by(METRICS.c.position, METRICS.c.main.desc())
    found: dict[int, Characteristic] = {}
    for row in production.connection.execute(asked).mappings():
        there = found.get(row["position"])
        if there is None:
            texts = {name: row[name] for name in Meaning._fields}
            texts |= {name: wording_of_today(row[name]) for name in WORDED}
            found[row["position"]] = Characteristic(
                **texts, limit_min=row["limit_min"], limit_max=row["limit_max"], sides=(row["side"],)
            )
        else:
            found[row["position"]] = there._replace(sides=(*there.sides, row["side"]))
    return tuple(
        one._replace(sides=tuple(side for side in one.sides if side != "both") or one.sides) for one in found.values()
    )


def characteristic(production: Production, lot: Lot, name: str, branch: str | None = None) -> Characteristic:
    """Return the metric of this name: its id, with its choices where the recipe has it more than once.

    Raises:
        StationError: there is none, or more than one; as `newest_run`.

    """
    return one_of(characteristics(production, lot), name, branch)


def one_of(there: Sequence[Characteristic], name: str, branch: str | None = None) -> Characteristic:
    """Return the metric of this name among those of a run; StationError as `characteristic`."""
    words = name.split() or [""]
    same = [one for one in there if one.metric == words[0] and branch in (None, one.branch)]
    found = [one for one in same if set(words[1:]) <= set(one.choices.split())]
    exact = [one for one in found if set(words[1:]) == set(one.choices.split())]
    chosen = exact if len(found) > 1 else found
    if len(chosen) == 1:
        return chosen[0]
    names = ", ".join(f"{one.name} ({one.branch})" if one.branch else one.name for one in (found or there))
    if not found:
        raise StationError(f"--metric: found '{name:.60}'; the newest run of this lot has the metrics {names}")
    raise StationError(
        f"--metric: a run has {len(found)} metrics of the name {name}: {names}. Choose one with --branch, or write its "
        "whole name in quotes"
    )


def values(production: Production, lot: Lot, what: Characteristic, side: str) -> list[ValueRow]:
    """Return the values of one side in the newest valid first attempts that mean the same by it, oldest first."""
    runs = production.chosen(lot, RUNS.c.valid, newest=lot.newest)
    columns = (
        *(runs.c[name] for name in ("run", "serial", "started", "bench")),
        METRICS.c.value,
        METRICS.c.uncertainty,
        METRICS.c.coverage_factor,
    )
    asked = _of(select(*columns), runs, what, side).where(_in_reach(production, lot)).order_by(runs.c.run)
    return [ValueRow._make(row) for row in production.connection.execute(asked).tuples()]


def part_runs(
    production: Production, serial: str, bench: str | None, *, virtual: bool, only: Sequence[str] | None = None
) -> Subquery:
    """Return the valid runs of one unit, a master part or not, without injected faults; all its attempts.

    only: ids of the runs that are meant; None: all.
    """
    columns = (RUNS.c.chain, *(RUNS.c[name] for name in ("run", "serial", "started", "bench")))
    asked = select(*columns).where(RUNS.c.chain == production.chain.id, RUNS.c.serial == serial, RUNS.c.valid)
    asked = asked.where(RUNS.c.scenario.is_(None), RUNS.c.virtual.is_(virtual), production.trusted())
    asked = asked if only is None else asked.where(RUNS.c.run.in_(only))
    return (asked if bench is None else asked.where(RUNS.c.bench == bench)).subquery()


def values_of_part(production: Production, runs: Subquery, what: Characteristic, side: str) -> list[ValueRow]:
    """Return the values of one side in the runs of a part, oldest first."""
    columns = (
        *(runs.c[name] for name in ("run", "serial", "started", "bench")),
        METRICS.c.value,
        METRICS.c.uncertainty,
        METRICS.c.coverage_factor,
    )
    asked = _of(select(*columns), runs, what, side).order_by(runs.c.run)
    return [ValueRow._make(row) for row in production.connection.execute(asked).tuples()]


def sums(  # noqa: PLR0917 - what is asked for
    production: Production, lot: Lot, what: Characteristic, side: str, by: str, origin: float
) -> dict[str, Sums]:
    """Return the sums of each group over the whole lot, about an origin near the mean, in the order of their names."""
    group = grouping(by)
    if group.by_hours and whole_hours(lot.since, lot.until):
        asked = _sums_of_hours(production, lot, what, side, group, origin)
    else:
        runs = production.chosen(lot, RUNS.c.valid, said=group.said)
        away = METRICS.c.value - origin
        columns = (group.column(runs).label("key"), func.count(), func.sum(away), func.sum(away * away))
        asked = _of(select(*columns), runs, what, side).group_by("key")
    found: dict[str, Sums] = {}
    names: dict[Any, str] = {}
    for key, number, first, second in production.connection.execute(asked):
        name = names.get(key) or names.setdefault(key, group.name(key))
        before = found.get(name, Sums(0, 0.0, 0.0))
        found[name] = Sums(before.number + number, before.first + first, before.second + second)
    return {name: found[name] for name in sorted(found)}


def _sums_of_hours(  # noqa: PLR0917 - what is asked for
    production: Production, lot: Lot, what: Characteristic, side: str, group: Grouping, origin: float
) -> Select[Any]:
    """Return a statement for key, number, sum and sum of squares about an origin, from the hours of a lot."""
    there = METRIC_HOURS.c
    away = there.mean - origin
    sums_of = (there.number, there.number * away, there.squares + there.number * away * away)
    key = group.column(METRIC_HOURS).label("key")
    asked = production.of_hours(select(key, *map(func.sum, sums_of)).select_from(METRIC_HOURS), METRIC_HOURS, lot)
    asked = asked.where(there.meaning.in_(numbers_of(what.meaning)), there.side == side, there.number > 0)
    return asked.group_by(key)


def other_meanings(production: Production, lot: Lot, what: Characteristic) -> int:
    """Return how many of the newest valid first attempts mean something else by a metric of this name."""
    named = {"metric": what.metric, "choices": what.choices, "branch": what.branch}
    others = meanings_of(production.connection, production.chain.id, **named).keys() - set(numbers_of(what.meaning))
    if not others:
        return 0
    runs = production.chosen(lot, RUNS.c.valid, newest=lot.newest)
    asked = select(func.count()).select_from(runs).join(METRICS, _together(runs)).where(METRICS.c.main)
    asked = asked.where(_in_reach(production, lot), METRICS.c.meaning.in_(sorted(others)))
    return int(production.connection.execute(asked).scalar_one())


class TestedBy(NamedTuple):
    """How many values were judged by these limits when they were measured, and by which revisions of the recipe."""

    limit_min: float | None
    limit_max: float | None
    number: int
    revisions: tuple[int, ...]


def tested_by(production: Production, lot: Lot, what: Characteristic, side: str) -> tuple[TestedBy, ...]:
    """Return by which limits the values that `values` returns were judged when they were measured, commonest first."""
    runs = production.chosen(lot, RUNS.c.valid, newest=lot.newest)
    by = (METRICS.c.limit_min, METRICS.c.limit_max, runs.c.revision)
    asked = _of(select(*by, func.count()), runs, what, side).where(_in_reach(production, lot)).group_by(*by)
    found: dict[tuple[float | None, float | None], TestedBy] = {}
    for low, high, revision, number in production.connection.execute(asked).tuples():
        there = found.get((low, high), TestedBy(low, high, 0, ()))
        revisions = {*there.revisions, *(() if revision is None else (revision,))}
        found[low, high] = TestedBy(low, high, there.number + number, tuple(sorted(revisions)))
    return tuple(sorted(found.values(), key=lambda one: -one.number))


def _of(asked: Select[Any], runs: Subquery, what: Characteristic, side: str) -> Select[Any]:
    asked = asked.select_from(runs).join(METRICS, _together(runs))
    asked = asked.where(METRICS.c.side == side, METRICS.c.value.is_not(None))
    return asked.where(METRICS.c.meaning.in_(numbers_of(what.meaning)))


def _in_reach(production: Production, lot: Lot) -> ColumnElement[bool]:
    """Return the condition that rows of metrics are not older than the runs that values are of."""
    return metrics_from(production, production.oldest_of(lot, RUNS.c.valid, newest=lot.newest))


def metrics_from(production: Production, oldest: str) -> ColumnElement[bool]:
    """Return the condition that rows of metrics are of a run or of later ones."""
    found: ColumnElement[bool] = (METRICS.c.chain == production.chain.id) & (METRICS.c.run >= oldest)
    return found


def _together(runs: Subquery) -> ColumnElement[bool]:
    return (METRICS.c.chain == runs.c.chain) & (METRICS.c.run == runs.c.run)
