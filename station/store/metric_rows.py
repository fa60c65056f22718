"""One metric over the runs of a store: every concluded run that is asked for, and what it has of the metric."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from operator import attrgetter
from typing import NamedTuple

from sqlalchemy import or_, select

from station.store.tables import METRICS, RUNS
from station.store.view import View


class MetricRow(NamedTuple):
    """One side of a metric of a run, with what is known of the run; `position` is None where it has no such metric.

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


def metric_rows(
    view: View, metric: str, side: str | None, recipe: str | None, serial: str | None
) -> Iterator[list[MetricRow]]:
    """Yield the rows of every concluded run that is asked for, oldest first.

    side: None for the side that the verdict goes by; any other comes behind that one.
    """
    together = (METRICS.c.chain == RUNS.c.chain) & (METRICS.c.run == RUNS.c.run) & (METRICS.c.metric == metric)
    together &= METRICS.c.main if side is None else or_(METRICS.c.main, METRICS.c.side == side)
    columns = [(RUNS if name in OF_THE_RUN else METRICS).c[name] for name in MetricRow._fields]
    asked = select(*columns).select_from(RUNS).outerjoin(METRICS, together).where(RUNS.c.chain == view.chain.id)
    if recipe is not None:
        asked = asked.where(RUNS.c.recipe.in_((recipe, "")))  # '' is that of a run.json that cannot be read
    if serial is not None:
        asked = asked.where(RUNS.c.serial == serial)
    asked = asked.order_by(RUNS.c.run, METRICS.c.position, METRICS.c.main.desc())
    with view.database.reading() as connection:
        rows = [MetricRow._make(row) for row in connection.execute(asked).all()]
    for _, group in groupby(rows, key=attrgetter("run")):
        yield list(group)


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
