"""Concluded runs as the store has them: what one says of itself, which of them are meant, and which are believed.

The list, the search, the table of runs and the shift report all read runs here.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Connection, Select, and_, func, or_, select

from station.records.chain.chain_file import Chain
from station.records.chain.walk import Trust
from station.store.plant.hours import between_hours, whole_hours
from station.store.tables import RUN_HOURS, RUNS


class StoredRun(NamedTuple):
    """A concluded run; the names are those of the columns. Its verdict counts only where `believed` leaves it.

    master: of a master part, the verdict that it should have; '' for a product. altered: a line for each alteration.
    in_production: of a product, and of no guided study; False for altered runs too.
    lock_angle_deg: of the locked shaft. first: the first attempt at its unit that is of its kind.
    """

    run: str
    started: str | None
    ended: str | None
    serial: str
    attempt: int
    model: str
    recipe: str
    revision: int | None
    bench: str
    operator: str | None
    clock: str | None
    virtual: bool
    master: str
    scenario: str | None
    state: str
    verdict: str | None
    objection: str
    altered: str
    records: int | None
    key: str | None
    seen: str
    seen_files: str
    in_production: bool = True
    fixture: str = ""
    lock_angle_deg: float | None = None
    first: bool = True


MOST_NAMED = 500
"""Runs that one statement names: databases have limits. Of more all are read."""

NO_LIMIT = 2**62
"""A limit that takes all rows: a database then reads these first, and does not look for them in another order."""

DEARER_BY_HOUR = 5
"""How many rows of an index in its order a database reads in the time of one that it looks up by its hour."""

LAST_CHARACTER = "\U0010ffff"

COLUMNS = [RUNS.c[name] for name in StoredRun._fields]


class Wanted(NamedTuple):
    """Which runs are meant; None takes all. begins: how a serial number begins. since, until: moments in UTC."""

    serial: str | None = None
    begins: str | None = None
    model: str | None = None
    recipe: str | None = None
    verdict: str | None = None
    operator: str | None = None
    since: str | None = None
    until: str | None = None
    master: str | None = None


def meant(asked: Select[Any], chain: Chain, wanted: Wanted) -> Select[Any]:
    """Return a statement on `RUNS` with the conditions by which runs are meant."""
    asked = asked.where(RUNS.c.chain == chain.id)
    for name in ("serial", "model", "recipe", "verdict", "operator", "master"):
        value = getattr(wanted, name)
        if value is not None:
            asked = asked.where(RUNS.c[name] == value)
    if wanted.begins:
        # As a range and not by LIKE, for which SQLite goes through all serial numbers.
        asked = asked.where(RUNS.c.serial >= wanted.begins, RUNS.c.serial < wanted.begins + LAST_CHARACTER)
    if wanted.since is not None:
        asked = asked.where(RUNS.c.started >= wanted.since)
    if wanted.until is not None:
        asked = asked.where(RUNS.c.started < wanted.until)
    return between_hours(asked, RUNS, wanted.since, wanted.until)


class Total(NamedTuple):
    """What a data folder holds: how many concluded runs, and by which recipes, of which models, in order."""

    runs: int
    recipes: tuple[str, ...]
    models: tuple[str, ...]


def total_of(connection: Connection, chain: Chain) -> Total:
    """Return what there is, by one look at the hours."""
    hours = RUN_HOURS.c
    asked = select(hours.recipe, hours.model, func.sum(hours.runs)).where(hours.chain == chain.id)
    found = connection.execute(asked.group_by(hours.recipe, hours.model)).all()
    recipes, models = ({row[place] for row in found} - {""} for place in (0, 1))
    return Total(sum(int(number) for *_, number in found), tuple(sorted(recipes)), tuple(sorted(models)))


def number_of(connection: Connection, chain: Chain, wanted: Wanted, total: Total) -> int:
    """Return how many concluded runs are meant: from the hours, where no serial number and no part of one is named."""
    if wanted == Wanted():
        return total.runs
    if wanted.serial is not None or wanted.begins or not whole_hours(wanted.since, wanted.until):
        asked = meant(select(func.count()).select_from(RUNS), chain, wanted)
        return int(connection.execute(asked).scalar() or 0)
    return _number_in_hours(connection, chain, wanted)


class Span(NamedTuple):
    """Some of the runs that are meant: at most so many, from the `first` newest on."""

    first: int
    most: int


def newest_meant(
    connection: Connection, chain: Chain, wanted: Wanted, span: Span, *, number: int, total: Total
) -> list[str]:
    """Return the ids of some runs that are meant, newest first; `number`: how many are meant, of those in total.

    A database goes to them from the newest run on, past all that are not meant. Where these are more than those that
    are, as with a week of last year, it takes the hours that have some, and sorts what it finds there.
    """
    asked = meant(select(RUNS.c.run), chain, wanted)
    if wanted.serial is None and not wanted.begins and wanted != Wanted():
        after = 0 if wanted.until is None else _number_in_hours(connection, chain, Wanted(since=wanted.until))
        passed = after + (span.first + span.most) * total.runs // max(number, 1)
        if number * DEARER_BY_HOUR < passed:
            hours = _of_hours(select(RUN_HOURS.c.hour).distinct(), chain, wanted)
            asked = select(asked.where(RUNS.c.hour.in_(hours)).limit(NO_LIMIT).subquery().c.run)
    (run,) = asked.selected_columns
    return list(connection.execute(asked.order_by(run.desc()).offset(span.first).limit(span.most)).scalars())


def _number_in_hours(connection: Connection, chain: Chain, wanted: Wanted) -> int:
    """Return how many concluded runs are meant in the hours that their time touches."""
    return int(connection.execute(_of_hours(select(func.sum(RUN_HOURS.c.runs)), chain, wanted)).scalar() or 0)


def _of_hours(asked: Select[Any], chain: Chain, wanted: Wanted) -> Select[Any]:
    asked = asked.where(RUN_HOURS.c.chain == chain.id)
    for name in ("model", "recipe", "verdict", "operator", "master"):
        value = getattr(wanted, name)
        if value is not None:
            asked = asked.where(RUN_HOURS.c[name] == value)
    return between_hours(asked, RUN_HOURS, wanted.since, wanted.until)


def is_trusted(key: str | None, chain: Chain, trust: Trust) -> bool:
    """Whether a run that this key signed counts; one from before the chain counts as the chain's first entry does."""
    if key is None and chain.start is not None:
        key = chain.start.key
    return key is None or key in trust.keys


def trusted(keys: Collection[str], *, unsigned_count: bool) -> ColumnElement[bool]:
    """Return the condition of `is_trusted` for the rows of runs; its negation holds for all others, also without a key.

    keys: those that are known. unsigned_count: `is_trusted` of a run that names no key.
    """
    # Not as `coalesce(key, '') IN`: PostgreSQL then expects one run in two hundred, and looks for the metrics of each.
    known = and_(RUNS.c.key.is_not(None), RUNS.c.key.in_(keys))
    return or_(RUNS.c.key.is_(None), known) if unsigned_count else known


def believed(run: StoredRun, chain: Chain, trust: Trust) -> StoredRun:
    """Return a run with its verdict, where its record is as it was left and somebody known signed it; else without."""
    altered = run.altered
    if not is_trusted(run.key, chain, trust):
        altered = "\n".join([*altered.splitlines(), f"is signed by {run.key}, which this computer does not know"])
    return run._replace(altered=altered, verdict=None if altered else run.verdict)


def runs_named(connection: Connection, chain: Chain, runs: Iterable[str]) -> dict[str, StoredRun]:
    """Return the concluded ones of these runs."""
    wanted = set(runs)
    asked = select(*COLUMNS).where(RUNS.c.chain == chain.id)
    if len(wanted) <= MOST_NAMED:
        asked = asked.where(RUNS.c.run.in_(wanted))
    rows = map(StoredRun._make, connection.execute(asked).all())
    return {row.run: row for row in rows if row.run in wanted}
