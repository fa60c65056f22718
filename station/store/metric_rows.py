"""One metric over the runs of a store: the runs that count, what they have of the metric, and the runs that do not.

Which runs count the database says: of those that do not there are few, and only of them is read why. A row says what
is asked of a run and of the side that the verdict goes by; of the other sides nothing but values is read.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator
from itertools import groupby
from operator import attrgetter
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, and_, func, select

from station.store.plant.hours import COMPLETE
from station.store.stored_runs import is_trusted
from station.store.tables import METRICS, RUNS
from station.store.view import View


class RunThatDoesNotCount(NamedTuple):
    """What there is against a run, or that it is of a master part or a study; the names are those of the columns."""

    run: str
    recipe: str
    state: str
    altered: str
    key: str | None
    objection: str
    master: str


class MetricRow(NamedTuple):
    """A metric of a run that counts by the side that its verdict goes by, with what is known of the run.

    `position` is None where the run has no such metric.

    The names are those of the columns; from `position` on they are of the metric.
    """

    run: str
    serial: str
    recipe: str
    revision: int
    bench: str
    started: str
    operator: str | None
    scenario: str | None
    virtual: bool
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


OF_THE_RUN = MetricRow._fields[: MetricRow._fields.index("position")]


def metric_rows(
    view: View, metric: str, recipe: str | None, serial: str | None, *, studies: bool
) -> Iterator[list[MetricRow]]:
    """Yield the rows of every run that counts and is asked for, oldest first. studies: those of guided studies too."""
    together = (METRICS.c.chain == RUNS.c.chain) & (METRICS.c.run == RUNS.c.run) & (METRICS.c.metric == metric)
    columns = [(RUNS if name in OF_THE_RUN else METRICS).c[name] for name in MetricRow._fields]
    asked = select(*columns).select_from(RUNS).outerjoin(METRICS, together & METRICS.c.main)
    asked = _meant(asked, view, recipe, serial).where(_counts(view, serial, studies=studies))
    # By the run alone, in which the rows lie already; those of one run are put in order here.
    with view.database.reading() as connection:
        rows = connection.execute(asked.order_by(RUNS.c.run)).all()
    for _, group in groupby(map(MetricRow._make, rows), attrgetter("run")):
        of_run = list(group)
        yield of_run if len(of_run) == 1 else sorted(of_run, key=_position)


def runs_that_do_not_count(
    view: View, recipe: str | None, serial: str | None, *, studies: bool
) -> list[RunThatDoesNotCount]:
    """Return the concluded runs that are asked for and do not count, oldest first."""
    asked = _meant(select(*(RUNS.c[name] for name in RunThatDoesNotCount._fields)), view, recipe, serial)
    asked = asked.where(~_counts(view, serial, studies=studies)).order_by(RUNS.c.run)
    with view.database.reading() as connection:
        return [RunThatDoesNotCount._make(row) for row in connection.execute(asked).tuples()]


def _meant(asked: Select[Any], view: View, recipe: str | None, serial: str | None) -> Select[Any]:
    asked = asked.where(RUNS.c.chain == view.chain.id)
    if recipe is not None:
        asked = asked.where(RUNS.c.recipe.in_((recipe, "")))  # '' is that of a run.json that cannot be read
    return asked if serial is None else asked.where(RUNS.c.serial == serial)


OF_A_STUDY = ~RUNS.c.in_production & (RUNS.c.altered == "") & (RUNS.c.master == "") & RUNS.c.scenario.is_(None)
"""That a run is of a guided study: nothing else takes it out of production."""


def _counts(view: View, serial: str | None, *, studies: bool) -> ColumnElement[bool]:
    """Return the condition that a run counts, as far as the store knows it; a master part does where it is named."""
    unsigned = [""] if is_trusted(None, view.chain, view.trust) else []
    found = and_(
        RUNS.c.recipe != "",
        RUNS.c.state == COMPLETE,
        RUNS.c.altered == "",
        RUNS.c.objection == "",
        func.coalesce(RUNS.c.key, "").in_([*view.trust.keys, *unsigned]),
    )
    if not studies:  # some units measured again and again: no sample of what is produced
        found = and_(found, ~OF_A_STUDY)
    return found if serial is not None else and_(found, RUNS.c.master == "")


def _position(row: MetricRow) -> int:
    return -1 if row.position is None else row.position


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
    of_metric = (METRICS.c.chain == view.chain.id) & (METRICS.c.metric == metric)
    newest = select(func.max(METRICS.c.run)).where(of_metric)
    asked_for = [RUNS.c[name] == value for name, value in (("recipe", recipe), ("serial", serial)) if value is not None]
    together = (METRICS.c.chain == RUNS.c.chain) & (METRICS.c.run == RUNS.c.run)
    newest = newest.select_from(METRICS).join(RUNS, and_(together, *asked_for))
    sides = select(METRICS.c.side).where(of_metric & (METRICS.c.run == newest.scalar_subquery()))
    with view.database.reading() as connection:
        rows = connection.execute(sides.order_by(METRICS.c.main.desc(), METRICS.c.position)).scalars().all()
    return tuple(dict.fromkeys(rows))
