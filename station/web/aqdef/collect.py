"""Which AQDEF file a sealed run belongs to, and when a file is complete: noted with how far the chain was read.

A file holds runs of one bench, model and recipe with its revision, and no virtual units beside real ones. By the unit
it holds one run; by the hour those that were sealed within an hour of UTC; by the lot those that follow one another on
a bench until another model, recipe or revision comes, the lot is full, or nothing has come for a while.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import Connection, insert, select, update

from station.records.chain.entries import Fields
from station.records.run_record import RunRecord
from station.reports.headline import virtual_badges
from station.results.sealed_runs import result_of
from station.wall_clock import WALL_CLOCK
from station.web.aqdef.settings import HOUR, LOT, UNIT, AqdefSettings
from station.web.people.database import AQDEF_FILES, AQDEF_READ, AQDEF_RUNS, StationDatabase
from station.web.people.read_chain import begin_at_the_end, read_on

OPEN, COMPLETE, MADE, WRITTEN, WITHOUT = "open", "complete", "made", "written", "without runs"
"""Stages of a file: takes runs, takes no more, has its bytes, is in the folder, none of its runs has a place in it."""

BEHIND_THE_HOUR_S = 5.0
"""How long a file by the hour is open behind its hour: for a run that was sealed at its end and is read a bit later."""

IN_NO_FILE = 0


class Part(NamedTuple):
    """What all runs of a file have in common; its fields name the file."""

    bench: str
    virtual: bool
    model: str
    recipe: str
    revision: int
    recipe_sha256: str


class _Sealed(NamedTuple):
    """A run that is to be written, and when it was sealed; part: None where it cannot be, which `why` says."""

    run: str
    sealed: datetime
    part: Part | None
    why: str = ""


def begin_here(database: StationDatabase, data: Path) -> None:
    """Note where the chain ends when the files are set up: earlier runs are written by 'quality dfq --out'."""
    with database.writing() as connection:
        begin_at_the_end(connection, AQDEF_READ, data)


def collect(database: StationDatabase, data: Path, settings: AqdefSettings) -> int:
    """Put each run that was sealed since the last look into its file, and end files that are complete.

    Returns how many runs were new. Raises StationError: the chain or the database cannot be read.
    """
    now = WALL_CLOCK.now()  # before the chain is read: what was sealed in an hour that is over is in it
    with database.reading() as connection:
        ending = any(_is_over(row, settings, now) for row in _open_files(connection))
    new = 0

    def put(connection: Connection, runs: Sequence[tuple[Fields, _Sealed | None]]) -> None:
        nonlocal new
        for _, one in runs:
            if one is not None and _is_new(connection, one.run):
                _put(connection, one, settings)
                new += 1
        for row in _open_files(connection):
            if _is_over(row, settings, now):
                _end(connection, row.number)

    read_on(database, data, AQDEF_READ, lambda fields: _counted(data, fields, settings), put, always=ending)
    return new


def _counted(data: Path, fields: Fields, settings: AqdefSettings) -> _Sealed | None:
    """Return a run that is to be written; None for one that came to no end or is no production.

    Which is that of a master part, with injected faults, or of a guided study.
    """
    if fields["state"] != "complete":
        return None
    moment = datetime.fromisoformat(fields["time"])
    altered, result = result_of(data, fields["run"])
    if result is None:
        return _Sealed(fields["run"], moment, None, altered[0] if altered else "it has no result")
    unit, bench = result.unit, "" if result.bench is None else result.bench.name
    if result.scenario is not None or unit is None or unit.master is not None or _of_study(data, fields["run"]):
        return None
    virtual = bool(virtual_badges(result))
    if virtual and not settings.virtual:
        return None
    recipe = result.recipe
    return _Sealed(
        fields["run"], moment, Part(bench, virtual, unit.model, recipe.name, recipe.revision, recipe.sha256)
    )  # fmt: skip


def _of_study(data: Path, run: str) -> bool:
    return RunRecord(data / run).manifest().study is not None


def _is_new(connection: Connection, run: str) -> bool:
    return connection.execute(select(AQDEF_RUNS.c.run).where(AQDEF_RUNS.c.run == run)).first() is None


def _open_files(connection: Connection) -> list[Any]:
    asked = select(AQDEF_FILES).where(AQDEF_FILES.c.stage == OPEN).order_by(AQDEF_FILES.c.number)
    return list(connection.execute(asked))


def _is_over(row: Any, settings: AqdefSettings, now: datetime) -> bool:
    """Say whether a file takes no more runs: its time is over, or files hold something else by now."""
    if row.per != settings.per:
        return True
    if row.per == HOUR:
        end = datetime.fromisoformat(f"{row.hour}:00:00+00:00") + timedelta(hours=1, seconds=BEHIND_THE_HOUR_S)
        return now >= end
    return _silent(row, settings, now)


def _silent(row: Any, settings: AqdefSettings, until: datetime) -> bool:
    """Say whether nothing came for a lot for as long as ends it: up to now, or to the run that came next."""
    return bool(until.timestamp() >= row.last_s + 3600.0 * settings.lot_silence_h)


def _put(connection: Connection, one: _Sealed, settings: AqdefSettings) -> None:
    if one.part is None:
        connection.execute(insert(AQDEF_RUNS).values(run=one.run, file=IN_NO_FILE, why=one.why))
        return
    part = json.dumps(one.part, ensure_ascii=False)
    hour = f"{one.sealed:%Y-%m-%dT%H}" if settings.per == HOUR else ""
    number, units = _file_for(connection, one, part, hour, settings)
    told = {"units": units + 1, "last_s": one.sealed.timestamp()}
    if number is None:
        made = insert(AQDEF_FILES).values(per=settings.per, part=part, hour=hour, stage=OPEN, **told)
        number = connection.execute(made).lastrowid
    else:
        connection.execute(update(AQDEF_FILES).where(AQDEF_FILES.c.number == number).values(**told))
    connection.execute(insert(AQDEF_RUNS).values(run=one.run, file=number, why=""))
    if settings.per == UNIT or (settings.per == LOT and units + 1 >= settings.lot_units):
        _end(connection, number)


def _file_for(
    connection: Connection, one: _Sealed, part: str, hour: str, settings: AqdefSettings
) -> tuple[int | None, int]:
    """Return number and units of the open file for a run, None where there is none; end the lot that it ends."""
    for row in _open_files(connection):
        if row.per != settings.per:
            continue
        same = (row.part, row.hour) == (part, hour)
        # By the times of the runs: several are read at once where nobody has looked during the silence.
        if same and not (settings.per == LOT and _silent(row, settings, one.sealed)):
            return row.number, row.units
        if settings.per == LOT and (same or _on_one_bench(row, one)):
            _end(connection, row.number)
    return None, 0


def _on_one_bench(row: Any, one: _Sealed) -> bool:
    return one.part is not None and Part(*json.loads(row.part))[:2] == one.part[:2]


def _end(connection: Connection, number: int) -> None:
    connection.execute(update(AQDEF_FILES).where(AQDEF_FILES.c.number == number).values(stage=COMPLETE))
