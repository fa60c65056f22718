"""The outbox of AQDEF files: complete ones get their bytes once, and are written until the folder has taken them.

The bytes are kept in the station's database before the folder gets them. So a kill at any moment loses none and writes
none with other content, a file that is there already is compared, and one of another content is never overwritten.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Connection, func, insert, select, update

from station.atomic_file import write_new
from station.errors import StationError
from station.quality.dfq.write import Alike, Written, alike, dfq_of_runs
from station.store.engine import StoreError
from station.store.quality.lot import Production, production
from station.version import version
from station.wall_clock import WALL_CLOCK, now_text
from station.web.aqdef.collect import COMPLETE, MADE, OPEN, WITHOUT, WRITTEN, Part, begin_here, collect
from station.web.aqdef.settings import AqdefSettings
from station.web.people.database import AQDEF_FILES, AQDEF_KNOWN, AQDEF_RUNS, StationDatabase

LOOK_EVERY_S = 1.0
FIRST_WAIT_S, LONGEST_WAIT_S = 1.0, 60.0
"""Wait before a file is tried again: doubled each time, up to the longest."""

CATCH_UP_S = 2.0
"""Longest time for putting runs into the store, in a look."""

LONGEST_REASON = 300
NOT_IN_A_NAME = re.compile(r"[^A-Za-z0-9.-]+")
LONGEST_PART_OF_A_NAME = 40
DOES_NOT_COUNT = "this run does not count: it was altered, or signed with an unknown key. See 'lostmotion verify'"


class Waiting(NamedTuple):
    """Files that the folder has not taken yet, runs that are in none, and why; '' : all is well.

    open: files that take further runs. waiting: complete ones. refused: runs without a file that nobody has
    acknowledged.
    """

    open: int
    waiting: int
    last_error: str
    refused: int
    last_refused: str


def waiting(connection: Connection) -> Waiting:
    """Return what has not been written, and what cannot be."""
    stages = dict(
        connection.execute(select(AQDEF_FILES.c.stage, func.count()).group_by(AQDEF_FILES.c.stage)).tuples().all()
    )
    left = select(AQDEF_FILES.c.last_error).where(AQDEF_FILES.c.stage == MADE, AQDEF_FILES.c.last_error != "")
    error = connection.execute(left.order_by(AQDEF_FILES.c.number).limit(1)).scalar() or ""
    newest = connection.execute(select(AQDEF_RUNS).where(_refused()).order_by(AQDEF_RUNS.c.run.desc()).limit(1)).first()
    why = "" if newest is None else f"run {newest.run}: {newest.why}"
    complete = stages.get(COMPLETE, 0) + stages.get(MADE, 0)
    return Waiting(stages.get(OPEN, 0), complete, error, refused(connection), why)


def _refused() -> ColumnElement[bool]:
    """Return the condition that a run is in no file, and that nobody has said that this is known."""
    return (AQDEF_RUNS.c.why != "") & AQDEF_RUNS.c.run.not_in(select(AQDEF_KNOWN.c.run))


def refused(connection: Connection) -> int:
    """Return how many runs are in no file without anybody having said that this is known."""
    return connection.execute(select(func.count()).select_from(AQDEF_RUNS).where(_refused())).scalar_one()


def acknowledge(connection: Connection, run: str, name: str, reason: str) -> int:
    """Note that somebody knows that a run is in no file; return how many are left. It stays in no file.

    Raises:
        StationError: the run is in a file, or waits for one, or this is known already.

    """
    if connection.execute(select(AQDEF_RUNS.c.run).where(_refused(), AQDEF_RUNS.c.run == run)).first() is None:
        raise StationError(
            f"Run {run[:80]!r} is not refused: it has a file, waits for one, or was acknowledged. See 'aqdef' in "
            "/api/now."
        )
    connection.execute(insert(AQDEF_KNOWN).values(run=run, name=name, at=now_text(), reason=reason))
    return refused(connection)


def look(database: StationDatabase, data: Path, settings: AqdefSettings, *, at_once: bool = False) -> int:
    """Collect what is new, make the files that are complete, and write those that are due; return how many were.

    at_once: also those whose wait is not over. Raises StationError: chain, store or database cannot be used.
    """
    collect(database, data, settings)
    _make(database, data)
    return _write(database, settings, at_once=at_once)


def _make(database: StationDatabase, data: Path) -> None:
    """Give each complete file its name and bytes."""
    with database.reading() as connection:
        asked = select(AQDEF_FILES.c.number).where(AQDEF_FILES.c.stage == COMPLETE).order_by(AQDEF_FILES.c.number)
        numbers = list(connection.execute(asked).scalars())
    if not numbers:
        return
    with production(data, most_s=CATCH_UP_S) as there:
        if there.behind:
            return  # what is not in the store yet would be missing in a file
        for number in numbers:
            _make_one(database, there, number)


def _make_one(database: StationDatabase, there: Production, number: int) -> None:
    """Make a file; runs that do not mean the same by their metrics, or have other limits, get files of their own."""
    with database.reading() as connection:
        row = connection.execute(select(AQDEF_FILES).where(AQDEF_FILES.c.number == number)).one()
        runs = list(connection.execute(select(AQDEF_RUNS.c.run).where(AQDEF_RUNS.c.file == number)).scalars())
    groups = alike(there, runs, virtual=Part(*json.loads(row.part)).virtual)
    why = dict.fromkeys(set(runs) - {run for one in groups for run in one.runs}, DOES_NOT_COUNT)
    found = [made for one in groups if (made := _made(there, one, why)) is not None]
    with database.writing() as connection:
        mine = (AQDEF_FILES.c.number == number) & (AQDEF_FILES.c.stage == COMPLETE)
        if not connection.execute(update(AQDEF_FILES).where(mine).values(stage=WITHOUT)).rowcount:
            return  # somebody else has made it
        for run, text in why.items():
            connection.execute(update(AQDEF_RUNS).where(AQDEF_RUNS.c.run == run).values(why=text))
        for place, (group, written) in enumerate(found):
            own = number
            if place:
                copied = {name: getattr(row, name) for name in ("per", "part", "hour", "last_s")}
                another = insert(AQDEF_FILES).values(stage=WITHOUT, units=len(group.runs), **copied)
                own = connection.execute(another).lastrowid
                moved = update(AQDEF_RUNS).where(AQDEF_RUNS.c.run.in_(group.runs))
                connection.execute(moved.values(file=own))
            digest = hashlib.sha256(written.content).hexdigest()
            bytes_of = {"content": written.content, "sha256": digest, "name": _name(row, group.runs[0], own)}
            connection.execute(
                update(AQDEF_FILES).where(AQDEF_FILES.c.number == own).values(stage=MADE, **bytes_of)
            )  # fmt: skip
    for run, text in why.items():
        sys.stderr.write(f"aqdef  run {run} is in no file: {text}\n")


def _made(there: Production, group: Alike, why: dict[str, str]) -> tuple[Alike, Written] | None:
    """Return the file of a group; of one that has no place in the format the runs that have, and note the others."""
    program = f"lostmotion {version()}"
    try:
        return group, dfq_of_runs(there, group, program)
    except StoreError:
        raise
    except StationError as error:
        if len(group.runs) == 1:
            why[group.runs[0]] = str(error)[:LONGEST_REASON]
            return None
        fits = [run for run in group.runs if _made(there, replace(group, runs=(run,)), why) is not None]
        if len(fits) == len(group.runs):
            raise  # each fits alone: whatever it is, it is no run's
    return _made(there, replace(group, runs=tuple(fits)), why) if fits else None


def _name(row: Any, first: str, number: int) -> str:
    """Return the name of a file: what it is of, and its number, by which two are never called the same."""
    part = Part(*json.loads(row.part))
    words = [part.bench, part.model, f"{part.recipe}-r{part.revision}", row.hour or first]
    plain = [NOT_IN_A_NAME.sub("-", word)[:LONGEST_PART_OF_A_NAME].strip("-.") or "unnamed" for word in words]
    return "_".join([*plain, f"{number:06d}"]) + ".dfq"


def _write(database: StationDatabase, settings: AqdefSettings, *, at_once: bool) -> int:
    """Write what is due, the oldest file first; a folder that does not take one is not asked for the others."""
    due = AQDEF_FILES.c.stage == MADE
    if not at_once:
        now_s = WALL_CLOCK.now().timestamp()
        # a wait longer than any: the clock was set back meanwhile
        due &= (AQDEF_FILES.c.next_s <= now_s) | (AQDEF_FILES.c.next_s > now_s + LONGEST_WAIT_S)
    with database.reading() as connection:
        rows = list(
            connection.execute(select(AQDEF_FILES.c.number).where(due).order_by(AQDEF_FILES.c.number)).scalars()
        )
    done = 0
    for number in rows:
        with database.reading() as connection:
            row = connection.execute(select(AQDEF_FILES).where(AQDEF_FILES.c.number == number)).one()
        away, error = _written(settings, row)
        done += not error
        tried = update(AQDEF_FILES).where(AQDEF_FILES.c.number == number)
        tried = tried.values(tries=row.tries + 1, last_error=error)
        if error:
            wait_s = min(LONGEST_WAIT_S, FIRST_WAIT_S * 2.0 ** min(row.tries, 16))
            tried = tried.values(next_s=WALL_CLOCK.now().timestamp() + wait_s)
        else:
            tried = tried.values(stage=WRITTEN, content=None, written_at=now_text())
        with database.writing() as connection:
            connection.execute(tried)
        if away:
            break
    return done


def _written(settings: AqdefSettings, row: Any) -> tuple[bool, str]:
    """Write a file; return whether the folder takes none now, and why this one was not taken, '' where it was."""
    folder = Path(settings.folder)
    try:
        if settings.mount_point is not None and not os.path.ismount(settings.mount_point):
            return True, f"{settings.mount_point}: no share is mounted there. Mount it"
        if write_new(folder / row.name, row.content):
            return False, ""
    except StationError as error:
        return True, str(error)[:LONGEST_REASON]
    return False, f"{folder / row.name}: is there with another content and is not overwritten. Move it away"


class Writer:
    """A thread of the server that writes the files."""

    def __init__(self, database: StationDatabase, data: Path, settings: AqdefSettings) -> None:
        """Prepare it."""
        self._database, self._data, self._settings = database, data, settings
        self._end = Event()
        self._thread = Thread(target=self._loop, name="aqdef", daemon=True)
        begin_here(database, data)

    def start(self) -> None:
        """Begin to write."""
        self._thread.start()

    def close(self) -> None:
        """End: what is not written is kept for the next start. A share that hangs is not waited for."""
        self._end.set()
        if self._thread.ident is not None:
            self._thread.join(timeout=2.0 * LOOK_EVERY_S)

    def _loop(self) -> None:
        told = ""
        while not self._end.wait(LOOK_EVERY_S):
            try:
                look(self._database, self._data, self._settings)
                with self._database.reading() as connection:
                    stand = waiting(connection)
                why = f"aqdef  files wait: {stand.last_error}\n" if stand.last_error else ""
            except (StationError, ValueError, KeyError) as error:
                why = f"aqdef  no file is written: {error}\n"  # nothing is lost either: it is looked at again
            if why != told:
                sys.stderr.write(why or "aqdef  files are written again\n")
            told = why
