"""Counts and sums by the hour, kept beside the runs in the same transaction: a year's trend reads some thousand rows.

An hour that a run comes to, changes in or leaves is counted anew from its rows, so that it does not matter in which
order they came: a store that was rebuilt has the same bits. Of values there are the mean and the sum of squared
differences from it, from which those of any group of hours follow without cancellation.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from functools import cache
from typing import Any

from sqlalchemy import (
    ColumnElement,
    Connection,
    Delete,
    FromClause,
    Insert,
    Select,
    Table,
    bindparam,
    case,
    delete,
    func,
    insert,
    literal_column,
    select,
    true,
)

from station.store.plant.meanings import meaning_of_metrics
from station.store.tables import ALARMS, CAUSE_HOURS, CHECKS, MEANINGS, METRIC_HOURS, METRICS, RUN_HOURS, RUNS

HOUR_DIGITS = len("2026-01-31T06")
FIRST_ATTEMPT = 1
FAIL, UNDECIDED = "FAIL", "NOT DECIDABLE"
COMPLETE = "complete"
ALARM, CHECK, UNNAMED, NEAR = "alarm", "check", "unnamed", "near"
"""Kinds of cause: an alarm in a run of any attempt; of first attempts without a verdict the checks that they did not
pass, measurements that are invalid by none, and metrics too near their limits."""

MOST_AT_ONCE = 200
"""Hours and runs that one statement names."""

WHOLE = re.compile(r"[0-9-]{10}T[0-9]{2}:00:00(?:\.0+)?\+00:00")
"""The beginning of an hour in UTC."""

NO_REVISION = -1
"""Revision of a recipe without one: a key has no empty columns."""

OF_RUNS = ("hour", "bench", "recipe", "revision", "model", "operator", "key")
"""What is known of the runs in both tables."""

OF_METRICS = ("meaning", "side")
"""What tells values from others."""

KNOWN_OF_VALUES = (*OF_RUNS, "fixture", "virtual")
"""What is known of the run of a value."""

CHAIN, HOURS = "counted_chain", "counted_hours"
"""Parameters of the statements that count: they are made once, which takes longer than to carry them out."""

_Which = Mapping[str, str | list[str]]
_Cause = tuple[ColumnElement[Any], Table | None, ColumnElement[int], ColumnElement[bool]]
"""A kind of cause: the name of each, the table beside the runs that has it, how many there are, and where."""


def hour_of(started: object) -> str:
    """Return the hour of a moment, '' where there is none."""
    return started[:HOUR_DIGITS] if isinstance(started, str) else ""


def whole_hours(since: str | None, until: str | None) -> bool:
    """Whether moments, None for any, are the beginnings of hours: then hours say as much as the runs themselves."""
    return all(moment is None or WHOLE.fullmatch(moment) for moment in (since, until))


def between_hours(asked: Select[Any], table: Table, since: str | None, until: str | None) -> Select[Any]:
    """Return a statement on a table with an hour, with those that the time from one moment to another touches."""
    hour = table.c.hour
    if since is not None:
        asked = asked.where(hour >= hour_of(since))
    if until is not None:
        last = hour_of(until)
        asked = asked.where(hour < last if whole_hours(None, until) else hour <= last, hour != "")
    return asked


def count_hours(connection: Connection, chain: str, hours: Collection[str]) -> None:
    """Count hours of a data folder anew."""
    there = sorted(hours)
    for begin in range(0, len(there), MOST_AT_ONCE):
        which: _Which = {CHAIN: chain, HOURS: there[begin : begin + MOST_AT_ONCE]}
        for table in (RUN_HOURS, METRIC_HOURS, CAUSE_HOURS):
            connection.execute(_forgotten(table), which)
        connection.execute(_runs_counted(), which)
        _count_metrics(connection, which)
        for kind in _causes_there(connection, which):
            connection.execute(_causes_counted(kind), which)


def count_all_hours(connection: Connection) -> None:
    """Count every hour of every data folder anew."""
    for chain in connection.execute(select(RUNS.c.chain).distinct()).scalars().all():
        hours = connection.execute(select(RUNS.c.hour).where(RUNS.c.chain == chain).distinct()).scalars()
        count_hours(connection, chain, set(hours))


@cache
def _forgotten(table: Table) -> Delete:
    return delete(table).where(_of_the_hours(table))


@cache
def _runs_counted() -> Insert:
    names = [column.name for column in RUN_HOURS.columns if column.name not in ("chain", "runs")]
    values = [RUNS.c.chain, *(_known(name).label(name) for name in names)]
    counted = select(*values, func.count()).where(_of_the_hours(RUNS))
    # By their places: a database does not see that two expressions with parameters are the same one.
    counted = counted.group_by(*(literal_column(str(place)) for place in range(1, len(values) + 1)))
    return insert(RUN_HOURS).from_select(["chain", *names, "runs"], counted)


@cache
def _values_asked() -> Select[Any]:
    of_runs = [_known(name) for name in KNOWN_OF_VALUES]
    of_metrics = [METRICS.c[name] for name in OF_METRICS]
    failed = case(((RUNS.c.verdict == FAIL) & (METRICS.c.verdict == FAIL), 1), else_=0)
    value = case((RUNS.c.valid, METRICS.c.value), else_=None)
    together = (METRICS.c.chain == RUNS.c.chain) & (METRICS.c.run == RUNS.c.run)
    asked = select(value, failed, *of_runs, *of_metrics).select_from(RUNS).join(METRICS, together)
    return asked.where(_of_the_hours(RUNS), RUNS.c.in_production, RUNS.c.first)


def _count_metrics(connection: Connection, which: _Which) -> None:
    groups: dict[Any, tuple[list[float], list[int]]] = defaultdict(lambda: ([], []))
    for one, bad, *key in connection.execute(_values_asked(), which):
        values, fails = groups[tuple(key)]
        fails.append(bad)
        if one is not None:
            values.append(one)
    names = (*KNOWN_OF_VALUES, *OF_METRICS)
    rows = [
        {"chain": which[CHAIN]} | dict(zip(names, key, strict=True)) | _sums(values) | {"failed": sum(fails)}
        for key, (values, fails) in groups.items()
        if values or any(fails)
    ]
    if rows:
        connection.execute(insert(METRIC_HOURS), rows)


def _causes_there(connection: Connection, which: _Which) -> list[str]:
    """Return the kinds of cause that runs may have: most hours have none, and a statement is dear to carry out."""
    found = [ALARM] if connection.execute(_alarm_asked(), which).first() else []
    undecided = connection.execute(_undecided_asked(), which).all()
    if any(state == COMPLETE for state, _ in undecided):
        found += [CHECK, UNNAMED]
    if any(valid for _, valid in undecided):
        found.append(NEAR)
    return found


@cache
def _alarm_asked() -> Select[Any]:
    return select(ALARMS.c.run).join(RUNS, _of_the_run(ALARMS)).where(_produced()).limit(1)


@cache
def _undecided_asked() -> Select[Any]:
    return select(RUNS.c.state, RUNS.c.valid).where(_no_verdict()).distinct()


@cache
def _causes_counted(kind: str) -> Insert:
    name, table, number, condition = _cause(kind)
    dims = [_known(one).label(one) for one in (*OF_RUNS, "virtual")]
    asked = select(RUNS.c.chain, literal_column(f"'{kind}'"), *dims, name, number)
    rows: FromClause = RUNS if table is None else RUNS.join(table, _of_the_run(table))
    rows = rows.join(MEANINGS, meaning_of_metrics()) if table is METRICS else rows
    asked = asked.select_from(rows).where(condition)
    places = (1, *range(3, 3 + len(dims)), *(() if table is None else (3 + len(dims),)))
    counted = asked.group_by(*(literal_column(str(place)) for place in places))
    return insert(CAUSE_HOURS).from_select(["chain", "kind", *OF_RUNS, "virtual", "name", "runs"], counted)


def _cause(kind: str) -> _Cause:
    if kind == ALARM:
        return func.coalesce(ALARMS.c.id, "None"), ALARMS, func.count(RUNS.c.run.distinct()), _produced()
    if kind == NEAR:
        return MEANINGS.c.metric, METRICS, func.count(), _no_verdict() & RUNS.c.valid & judged_as(UNDECIDED)
    ended, failed = _no_verdict() & (RUNS.c.state == COMPLETE), CHECKS.c.passed.is_(False)
    if kind == CHECK:
        return CHECKS.c.id, CHECKS, func.count(), ended & failed
    named = select(CHECKS.c.run).where(_of_the_run(CHECKS), failed).exists()
    return literal_column("''"), None, func.count(), ended & (RUNS.c.objection != "") & ~named


def _of_the_hours(table: Table) -> ColumnElement[bool]:
    """Return the condition that a row is of the hours that are counted."""
    found: ColumnElement[bool] = table.c.chain == bindparam(CHAIN)
    return found & table.c.hour.in_(bindparam(HOURS, expanding=True))


def _produced() -> ColumnElement[bool]:
    return _of_the_hours(RUNS) & RUNS.c.in_production


def _no_verdict() -> ColumnElement[bool]:
    return _produced() & RUNS.c.first & (RUNS.c.verdict == UNDECIDED)


def judged_as(verdict: str) -> ColumnElement[bool]:
    """Return the condition that a row of the metrics is the main one of a metric with this verdict, FAIL or undecided.

    Each row has the verdict of its side; that of the metric is the worst of them.
    """
    other = METRICS.alias()
    together = [other.c[name] == METRICS.c[name] for name in ("chain", "run", "position")]
    there = {one: select(other.c.side).where(*together, other.c.verdict == one).exists() for one in (FAIL, UNDECIDED)}
    return METRICS.c.main & there[verdict] & (true() if verdict == FAIL else ~there[FAIL])


def _of_the_run(table: Table) -> ColumnElement[bool]:
    found: ColumnElement[bool] = (table.c.chain == RUNS.c.chain) & (table.c.run == RUNS.c.run)
    return found


def _sums(values: Iterable[float]) -> dict[str, float]:
    """Return number, mean and sum of squared differences; each rounded once, in whichever order the values come."""
    there = list(values)
    if not there:
        return {"number": 0, "mean": 0.0, "squares": 0.0}
    mean = math.fsum(there) / len(there)
    return {"number": len(there), "mean": mean, "squares": math.fsum((one - mean) ** 2 for one in there)}


def _known(name: str) -> ColumnElement[Any]:
    """Return a column of a run as it stands in a key."""
    if name == "revision":
        return func.coalesce(RUNS.c.revision, NO_REVISION)
    column: ColumnElement[Any] = RUNS.c[name]
    return func.coalesce(column, "") if name in ("operator", "key", "verdict") else column
