"""Concluded runs as the store has them: what one says of itself, which of them are meant, and which are believed.

The list, the search, the table of runs and the shift report all read runs here.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from sqlalchemy import Connection, Select, func, select

from station.records.chain.chain_file import Chain
from station.records.chain.walk import Trust
from station.store.plant.hours import between_hours, whole_hours
from station.store.tables import RUN_HOURS, RUNS


class StoredRun(NamedTuple):
    """A concluded run; the names are those of the columns. Its verdict counts only where `believed` leaves it.

    master: of a master part, the verdict that it should have; '' for a product. altered: a line for each alteration.
    in_production: of a product, and of no guided study; False for altered runs too.
    lock_angle_deg: of the locked shaft.
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


MOST_NAMED = 500
"""Runs that one statement names: databases have limits. Of more all are read."""

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
    return asked


def number_of(connection: Connection, chain: Chain, wanted: Wanted) -> int:
    """Return how many concluded runs are meant: from the hours, where no serial number and no part of one is named."""
    if wanted.serial is not None or wanted.begins or not whole_hours(wanted.since, wanted.until):
        asked = meant(select(func.count()).select_from(RUNS), chain, wanted)
    else:
        asked = select(func.sum(RUN_HOURS.c.runs)).where(RUN_HOURS.c.chain == chain.id)
        for name in ("model", "recipe", "verdict", "operator", "master"):
            value = getattr(wanted, name)
            if value is not None:
                asked = asked.where(RUN_HOURS.c[name] == value)
        asked = between_hours(asked, RUN_HOURS, wanted.since, wanted.until)
    return int(connection.execute(asked).scalar() or 0)


def is_trusted(key: str | None, chain: Chain, trust: Trust) -> bool:
    """Whether a run that this key signed counts; one from before the chain counts as the chain's first entry does."""
    if key is None and chain.start is not None:
        key = chain.start.key
    return key is None or key in trust.keys


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


def values_of(connection: Connection, chain: Chain, column: str) -> tuple[str, ...]:
    """Return the different values of a column with an index, in order, by a step in it for each.

    A statement that reads them all takes as long as there are runs.
    """
    found: list[str] = []
    least = select(func.min(RUNS.c[column])).where(RUNS.c.chain == chain.id)
    while (
        value := connection.execute(least.where(RUNS.c[column] > (found[-1] if found else ""))).scalar()
    ) is not None:
        found.append(str(value))
    return tuple(found)
