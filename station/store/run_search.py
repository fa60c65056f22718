"""Runs of a data folder as a person looks for them: a page of rows at a time, newest first, whatever the folder holds.

A look at the whole folder compares every run with its folder, which takes longer the more there are. Here only the rows
that are shown are compared: one whose folder is missing, or has changed since its hashes were compared, has no verdict.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import Select, func, select

from station.records.chain.chain_file import Chain
from station.records.chain.walk import trust_of
from station.records.run_record import MANIFEST, RunRecord
from station.store.outbox import catch_up
from station.store.projection import seen, seen_files
from station.store.tables import RUNS
from station.store.view import opened

MOST_ROWS = 500
CATCH_UP_S = 0.5
"""Longest time for putting runs into the store that have come since; the rest is there at the next look."""


class Wanted(NamedTuple):
    """What is looked for; None takes all. serial: how it begins. since, until: moments in UTC, as runs have them."""

    serial: str | None = None
    recipe: str | None = None
    verdict: str | None = None
    operator: str | None = None
    since: str | None = None
    until: str | None = None


class RunRow(NamedTuple):
    """A concluded run; verdict: None where it has none, or its record is not as it was left, which `doubt` says."""

    run: str
    serial: str
    attempt: int
    recipe: str
    revision: int | None
    started: str | None
    operator: str | None
    state: str
    verdict: str | None
    virtual: bool
    scenario: str | None
    doubt: str


@dataclass(frozen=True)
class Page:
    """Some of the runs that are meant, newest first, how many there are, and all recipes of the folder."""

    rows: tuple[RunRow, ...]
    total: int
    recipes: tuple[str, ...]


def search(data: Path, wanted: Wanted, *, first: int = 0, count: int = 100) -> Page:
    """Return `count` of the runs that are meant, from the `first` newest on; `count` at most `MOST_ROWS`.

    Raises:
        StoreError, RecordError: the store cannot be used, or the chain not be read.

    """
    chain = Chain(data)
    database = opened(data)
    try:
        catch_up(database, chain, most_s=CATCH_UP_S)
        kept = [name for name in RunRow._fields if name != "doubt"]
        columns = [RUNS.c[name] for name in (*kept, "altered", "key", "seen", "seen_files")]
        asked = _meant(select(*columns), chain, wanted).order_by(RUNS.c.run.desc())
        with database.reading() as connection:
            found = connection.execute(asked.offset(first).limit(min(count, MOST_ROWS))).all()
            total = connection.execute(_meant(select(func.count()).select_from(RUNS), chain, wanted)).scalar_one()
            names = select(RUNS.c.recipe).where(RUNS.c.chain == chain.id).distinct().order_by(RUNS.c.recipe)
            recipes = tuple(name for name in connection.execute(names).scalars() if name)
    finally:
        database.close()
    trusted = trust_of(chain).keys
    rows = []
    for *entries, altered, key, was, files in found:
        row = RunRow._make([*entries, ""])
        doubt = _doubt(data, row.run, (was, files), altered)
        if not doubt and key is not None and key not in trusted:
            doubt = f"It is signed by {key}, which this computer does not know."
        rows.append(row._replace(doubt=doubt, verdict=None if doubt else row.verdict))
    return Page(tuple(rows), total, recipes)


def _doubt(data: Path, run: str, was: tuple[str, str], altered: str) -> str:
    if altered:
        return altered.splitlines()[0]
    now = seen(str(data / run / MANIFEST))
    if not now:
        return "Its folder is missing."
    same = (now, seen_files(RunRecord(data / run))) == was
    return "" if same else "Its record was changed since it was last compared. Run 'lostmotion verify'."


def _meant(asked: Select[Any], chain: Chain, wanted: Wanted) -> Select[Any]:
    asked = asked.where(RUNS.c.chain == chain.id)
    if wanted.serial:
        asked = asked.where(RUNS.c.serial.startswith(wanted.serial, autoescape=True))
    for name in ("recipe", "verdict", "operator"):
        value = getattr(wanted, name)
        if value:
            asked = asked.where(RUNS.c[name] == value)
    if wanted.since:
        asked = asked.where(RUNS.c.started >= wanted.since)
    if wanted.until:
        asked = asked.where(RUNS.c.started < wanted.until)
    return asked
