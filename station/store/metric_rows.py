"""One metric over the runs of a store: every concluded run that is asked for, and what it has of the metric.

A row says all of a run and of the side that the verdict goes by; of the other sides nothing but values is read.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator
from itertools import groupby
from operator import itemgetter
from typing import NamedTuple

from sqlalchemy import select

from station.store.tables import METRICS, RUNS
from station.store.view import View


class MetricRow(NamedTuple):
    """A metric of a run by the side that its verdict goes by, with what is known of the run.

    `position` is None where the run has no such metric.

    The names are those of the columns; from `position` on they are of the metric.
    """

    run: str
    serial: str
    state: str
    altered: str
    key: str | None
    objection: str
    recipe: str
    revision: int
    bench: str
    started: str
    operator: str | None
    scenario: str | None
    virtual: bool
    master: str
    torque_source: str
    position: int | None
    side: str
    definition: str
    unit: str
    branch: str
    estimator: str
    band: str
    torque_nm: str
    choices: str
    value: float | None
    limit_min: float | None
    limit_max: float | None


MOST_SIDES = 100
"""Rows that the sides of one run's metric are looked for in: two sides, and what a recipe asks of the metric again."""

OF_THE_RUN = MetricRow._fields[: MetricRow._fields.index("position")]


def metric_rows(view: View, metric: str, recipe: str | None, serial: str | None) -> Iterator[list[MetricRow]]:
    """Yield the rows of every concluded run that is asked for, oldest first."""
    together = (METRICS.c.chain == RUNS.c.chain) & (METRICS.c.run == RUNS.c.run) & (METRICS.c.metric == metric)
    columns = [(RUNS if name in OF_THE_RUN else METRICS).c[name] for name in MetricRow._fields]
    asked = select(*columns).select_from(RUNS).outerjoin(METRICS, together & METRICS.c.main)
    asked = asked.where(RUNS.c.chain == view.chain.id)
    if recipe is not None:
        asked = asked.where(RUNS.c.recipe.in_((recipe, "")))  # '' is that of a run.json that cannot be read
    if serial is not None:
        asked = asked.where(RUNS.c.serial == serial)
    asked = asked.order_by(RUNS.c.run, METRICS.c.position)
    with view.database.reading() as connection:
        rows = connection.execute(asked).all()
    for _, group in groupby(map(MetricRow._make, rows), key=itemgetter(0)):
        yield list(group)


Place = tuple[str, int | None]
"""Run and position of a metric in it."""


def values_beside(view: View, metric: str, sides: Collection[str]) -> dict[str, dict[Place, float | None]]:
    """Return the values of these sides, by side, where they are not those that the verdict goes by."""
    found: dict[str, dict[Place, float | None]] = defaultdict(dict)
    columns = (METRICS.c.side, METRICS.c.run, METRICS.c.position, METRICS.c.value)
    asked = select(*columns).where(METRICS.c.chain == view.chain.id, METRICS.c.metric == metric)
    asked = asked.where(METRICS.c.side.in_(sides), ~METRICS.c.main)
    if sides:
        with view.database.reading() as connection:
            for side, run, position, value in connection.execute(asked).all():
                found[side][run, position] = value
    return found


def sides_of(view: View, metric: str, recipe: str | None, serial: str | None) -> tuple[str, ...]:
    """Return the sides that the newest run with the metric has of it; none where no run has it."""
    together = (METRICS.c.chain == RUNS.c.chain) & (METRICS.c.run == RUNS.c.run)
    asked = select(METRICS.c.run, METRICS.c.side).select_from(RUNS).join(METRICS, together)
    asked = asked.where(RUNS.c.chain == view.chain.id, METRICS.c.metric == metric)
    if recipe is not None:
        asked = asked.where(RUNS.c.recipe == recipe)
    if serial is not None:
        asked = asked.where(RUNS.c.serial == serial)
    asked = asked.order_by(METRICS.c.run.desc(), METRICS.c.main.desc()).limit(MOST_SIDES)
    with view.database.reading() as connection:
        rows = connection.execute(asked).all()
    return tuple(dict.fromkeys(side for run, side in rows if run == rows[0][0]))
