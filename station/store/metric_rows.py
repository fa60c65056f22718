"""One metric over the runs of a store: the runs that count, what they have of the metric, and the runs that do not.

Which runs count the database says: of those that do not there are few, and only of them is read why. Of a run and of
the side that the verdict goes by no more is read than is asked for, and what a metric means is read once for all runs;
of the other sides nothing but values is read.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, and_, func, null, select

from station.store.plant.hours import COMPLETE
from station.store.plant.meanings import Meaning, meanings_of
from station.store.stored_runs import MOST_NAMED, is_trusted, trusted
from station.store.tables import METRICS, RUNS
from station.store.view import View


class RunThatDoesNotCount(NamedTuple):
    """What there is against a run, or that it is of a master part or a study; the names are those of the columns."""

    run: str
    serial: str
    recipe: str
    state: str
    altered: str
    key: str | None
    objection: str
    master: str


SAID = ("bench", "started", "operator")
"""What is known of a run, and read only where it is asked for; it does not decide whether a value counts."""


class MetricRow(NamedTuple):
    """A metric of a run that counts by the side that its verdict goes by, with what is known of the run.

    What of SAID was not asked for is None. meaning: number of what the metric means.

    The names are those of the columns; from `position` on they are of the metric, and None where the run has none.
    """

    run: str
    serial: str
    recipe: str
    revision: int
    scenario: str | None
    virtual: bool
    torque_source: str
    bench: str | None
    started: str | None
    operator: str | None
    position: int | None
    side: str
    meaning: int
    value: float | None


_OF_THE_METRIC = MetricRow._fields[MetricRow._fields.index("position") :]
_OF_THE_RUN = MetricRow._fields[: -len(_OF_THE_METRIC)]


class MetricOfRuns(NamedTuple):
    """The runs that count and are asked for, oldest first, each with its rows of the metric, at least one.

    meanings: what is meant by the metric, by number.
    """

    runs: list[list[MetricRow]]
    meanings: Mapping[int, Meaning]


def metric_rows(
    view: View, metric: str, recipe: str | None, serial: str | None, said: Collection[str] = SAID, *, studies: bool
) -> MetricOfRuns:
    """Return the rows of every run that counts and is asked for.

    said: what of SAID is read. studies: runs of guided studies count too.
    """
    of_run = [RUNS.c[name] if name in said or name not in SAID else null() for name in _OF_THE_RUN]
    with view.database.reading() as connection:
        meanings = meanings_of(connection, view.chain.id, metric=metric)
        # All that is read of a metric stands in its index.
        together = (METRICS.c.chain == RUNS.c.chain) & (METRICS.c.run == RUNS.c.run)
        together &= METRICS.c.meaning.in_(meanings) & METRICS.c.main
        asked = select(*of_run, *(METRICS.c[name] for name in _OF_THE_METRIC))
        asked = _meant(asked.select_from(RUNS).outerjoin(METRICS, together), view, recipe, serial)
        # By the run alone, in which the rows lie already; those of one run are put in order below.
        asked = asked.where(_counts(view, serial, studies=studies)).order_by(RUNS.c.run)
        rows = list(map(MetricRow._make, connection.execute(asked).all()))
    runs: list[list[MetricRow]] = []
    before = ""
    for row in rows:
        if row.run == before:
            runs[-1] = sorted([*runs[-1], row], key=_position)
        else:
            runs.append([row])
        before = row.run
    return MetricOfRuns(runs, meanings)


def _position(row: MetricRow) -> int:
    return -1 if row.position is None else row.position


def _of_meanings(view: View, meanings: Collection[int]) -> Select[Any]:
    return select(METRICS.c.run).where(METRICS.c.chain == view.chain.id, METRICS.c.meaning.in_(meanings))


def _of_few(asked: Select[Any], runs: Collection[str]) -> Select[Any]:
    """Return a statement on metrics for some runs; for many of them it stays one for all runs."""
    return asked if len(runs) > MOST_NAMED else asked.where(METRICS.c.run.in_(runs))


def limits_of(view: View, row: MetricRow) -> tuple[float | None, float | None]:
    """Return the lower and the upper limit of a metric in a run."""
    asked = select(METRICS.c.limit_min, METRICS.c.limit_max).where(METRICS.c.chain == view.chain.id)
    asked = asked.where(METRICS.c.run == row.run, METRICS.c.position == row.position, METRICS.c.main)
    with view.database.reading() as connection:
        lower, upper = connection.execute(asked).one()
    return lower, upper


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
    found = and_(
        RUNS.c.recipe != "",
        RUNS.c.state == COMPLETE,
        RUNS.c.altered == "",
        RUNS.c.objection == "",
        trusted(view.trust.keys, unsigned_count=is_trusted(None, view.chain, view.trust)),
    )
    if not studies:  # some units measured again and again: no sample of what is produced
        found = and_(found, ~OF_A_STUDY)
    return found if serial is not None else and_(found, RUNS.c.master == "")


Place = tuple[str, int | None]
"""Run and position of a metric in it."""


def values_beside(
    view: View, meanings: Collection[int], sides: Collection[str], runs: Collection[str]
) -> dict[str, dict[Place, float | None]]:
    """Return the values of these sides in some runs, by side, where they are not those that the verdict goes by."""
    found: dict[str, dict[Place, float | None]] = defaultdict(dict)
    columns = (METRICS.c.side, METRICS.c.run, METRICS.c.position, METRICS.c.value)
    asked = _of_meanings(view, meanings).with_only_columns(*columns)
    asked = _of_few(asked.where(METRICS.c.side.in_(sides), ~METRICS.c.main), runs)
    if sides:
        with view.database.reading() as connection:
            for side, run, position, value in connection.execute(asked).all():
                found[side][run, position] = value
    return found


def sides_of(view: View, metric: str, recipe: str | None, serial: str | None) -> tuple[str, ...]:
    """Return the sides that the newest run with the metric has of it; none where no run has it."""
    asked_for = [RUNS.c[name] == value for name, value in (("recipe", recipe), ("serial", serial)) if value is not None]
    together = (METRICS.c.chain == RUNS.c.chain) & (METRICS.c.run == RUNS.c.run)
    with view.database.reading() as connection:
        of_metric = _of_meanings(view, meanings_of(connection, view.chain.id, metric=metric))
        newest = of_metric.with_only_columns(func.max(METRICS.c.run)).select_from(METRICS)
        newest = newest.join(RUNS, and_(together, *asked_for))
        sides = of_metric.with_only_columns(METRICS.c.side).where(METRICS.c.run == newest.scalar_subquery())
        rows = connection.execute(sides.order_by(METRICS.c.main.desc(), METRICS.c.position)).scalars().all()
    return tuple(dict.fromkeys(rows))
