"""A data folder as its store shows it: brought up to the chain, and held against the folders as they are now.

What is compared each time: that every run is there, and size, times and inode of its run.json with those of when its
hashes were last compared; of the newest runs the same of every file. What differs is compared by its hashes, and goes
into the store anew. `lostmotion verify` compares every byte.
"""

from __future__ import annotations

import gc
import os
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from sqlalchemy import Connection, select

from station.atomic_file import seen_text
from station.errors import RecordError
from station.records.chain.chain_file import Chain
from station.records.chain.head import chain_seen_in
from station.records.chain.missing import altered_problem
from station.records.chain.problems import Problem
from station.records.chain.walk import Trust, end_problems, key_problems, trust_of
from station.records.folder_check import folder_problems, name_problems, runs_before, unknown_seals
from station.records.run_folders import is_text, moment_of, runs_there
from station.records.run_record import MANIFEST, RunRecord
from station.records.seal import is_sealed
from station.store.engine import Database, StoreError
from station.store.engines import IN_MEMORY
from station.store.outbox import BATCH, catch_up, hold_up, put_runs, remove_runs, stored_walk
from station.store.places import StorePlace, store_place
from station.store.plant.removals import removals
from station.store.rows.projection import seen_files, waits_for_its_name
from station.store.tables import ATTEMPTS, RECIPES, RUNS
from station.there import NOT_THERE

EVERY_FILE_OF = 200
"""Newest runs of which every file is compared, and not run.json alone."""

LONG = 500
"""Runs from which on it is said that the store is behind: putting them in takes a second or more."""


@dataclass
class View:
    """One look at a data folder: its runs that were begun, in order, and what is wrong."""

    data: Path
    chain: Chain
    database: Database
    trust: Trust
    runs: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    open: list[str] = field(default_factory=list)
    """Runs that were begun, and not concluded yet."""
    problems: list[Problem] = field(default_factory=list)


@contextmanager
def without_collector() -> Iterator[None]:
    """Keep Python from looking for cycles among twenty thousand rows, which takes as long as to read them."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


@contextmanager
def look_at(data: Path) -> Iterator[View]:
    """Yield a view of a data folder; without a store that can be used, of a store in memory, which is said.

    Who looks reads rows of many runs: until the end of the look Python does not search them for cycles.

    Raises:
        RecordError: the chain cannot be read.

    """
    chain = Chain(data)
    with without_collector(), _view_of(data, chain) as view:
        yield view


@contextmanager
def _view_of(data: Path, chain: Chain) -> Iterator[View]:
    try:
        database = opened(data)
        try:
            view = _looked(data, chain, database)
        except BaseException:
            database.close()
            raise
    except StoreError as error:
        warn(f"{error}. The run folders are read instead, which takes longer")
        database = Database(StorePlace(IN_MEMORY))
        view = _looked(data, chain, database)
    try:
        yield view
    finally:
        database.close()


def opened(data: Path, *, may_take_long: bool = False) -> Database:
    """Return the store of a data folder; StoreError where it cannot be used.

    may_take_long: bring also a big store of an older version to this one, which takes minutes.
    """
    place = store_place(data)
    if place.note:
        warn(place.note)
    return Database(place, may_take_long=may_take_long)


def warn(text: str) -> None:
    """Tell a person what is not as it should be, and changes no result."""
    sys.stderr.write(f"WARNING  {text}\n")


def _looked(data: Path, chain: Chain, database: Database) -> View:
    catch_up(database, chain, told=_tell, warned=warn)
    there = _folders(data)
    folders = {name: seen_then for name, seen_then in there.items() if is_text(name)}
    hold_up(database, chain, told=_tell, warned=warn)
    with database.reading() as connection:
        stored, altered = _stored(connection, chain)
        files = _files_of_newest(connection, chain, folders)
    changed, strays = _compared(chain, stored, files, folders)
    # A chain that this computer has seen here is away, maybe for a moment: what it said of its runs stays.
    kept = chain.there or chain_seen_in(data) is not None
    gone = [] if kept else [run for run in stored if run not in folders]
    if changed or gone:
        database.let_go()
        remove_runs(database, chain, gone)
        put_runs(database, chain, changed)
        hold_up(database, chain, told=_tell, warned=warn)
    view = View(data, chain, database, trust_of(chain))
    with database.reading() as connection:
        stored, altered = _stored(connection, chain) if changed or gone else (stored, altered)
        found = stored_walk(connection, chain)
        before, old_problems = runs_before(chain)
        known = {*stored, *before} if chain.there else set(folders)
        absent = [run for run in stored if run not in folders]
        removed = set(removals(connection, chain, view.trust)) if absent or known - folders.keys() else set()
    view.missing = [run for run in absent if run not in removed]
    view.runs = sorted([*folders, *view.missing])
    view.open = [run for run, was in stored.items() if was is None and run in folders]
    held: dict[str, str | None] = dict(zip(folders, folders, strict=True))
    held |= {name: _named_in(data, name) for name in {*changed, *strays, *altered} if name in folders}
    sealed = {run for run, was in stored.items() if was is not None}
    named = folder_problems(chain, known, held, _About(database, chain), sealed=sealed, removed=removed)
    told = {problem.run for problem in named}
    foreign = key_problems(found, view.trust)
    view.problems = [*found.problems, *end_problems(chain, found.place), *foreign]
    if foreign:
        doubtful = [run for run, was in stored.items() if was is None or run not in folders]
        open_still = [run for run in doubtful if run not in removed]
        view.problems += unknown_seals(chain, open_still, view.trust.keys)
    view.problems += [*old_problems, *named, *name_problems(there)]
    view.problems += [
        altered_problem(run, text)
        for run, texts in altered.items()
        if run not in told and run in folders
        for text in texts
        if not waits_for_its_name(text)
    ]
    return view


class _About:
    """Says of a run by what a person looks for it; the store is asked once, and only where a run is missing."""

    def __init__(self, database: Database, chain: Chain) -> None:
        self._database, self._chain = database, chain

    def __call__(self, run: str) -> str:
        return self._texts.get(run, "from before the chain")

    @cached_property
    def _texts(self) -> dict[str, str]:
        together = (RUNS.c.chain == ATTEMPTS.c.chain) & (RUNS.c.run == ATTEMPTS.c.run)
        asked = select(ATTEMPTS.c.run, ATTEMPTS.c.attempt, ATTEMPTS.c.serial, RUNS.c.verdict)
        asked = asked.select_from(ATTEMPTS).outerjoin(RUNS, together).where(ATTEMPTS.c.chain == self._chain.id)
        with self._database.reading() as connection:
            rows = connection.execute(asked).all()
        return {run: f"attempt {attempt} of {serial}, {verdict}" for run, attempt, serial, verdict in rows}


def _tell(done: int, there: int) -> None:
    if there > LONG and (done == BATCH or done % (10 * LONG) == 0):
        warn(f"the store is behind by {there - done} runs: putting them in")


def _folders(data: Path) -> dict[str, str]:
    """Return every folder that is a run, in order, and what is seen of its run.json; as `is_run`."""
    found = {}
    handle = os.open(data, os.O_RDONLY | os.O_DIRECTORY)
    try:
        for name in sorted(os.listdir(handle)):  # noqa: PTH208 - as in `seen`
            try:  # what `seen` does, without a call for each of twenty thousand
                found[name] = seen_text(os.stat(f"{name}/{MANIFEST}", dir_fd=handle))
            except OSError as error:
                if error.errno not in NOT_THERE and moment_of(name) is not None:
                    found[name] = ""  # as `seen` has of it: who reads it is told why nobody can
    finally:
        os.close(handle)
    return found


def _stored(connection: Connection, chain: Chain) -> tuple[dict[str, str | None], dict[str, list[str]]]:
    """Return what was seen of the run.json of every run that was begun, and the alterations of those that have any.

    None where a run was not concluded. Oldest first.
    """
    concluded = (RUNS.c.chain == ATTEMPTS.c.chain) & (RUNS.c.run == ATTEMPTS.c.run)
    begun = select(ATTEMPTS.c.run, RUNS.c.seen, RUNS.c.altered).select_from(ATTEMPTS).outerjoin(RUNS, concluded)
    rows = connection.execute(begun.where(ATTEMPTS.c.chain == chain.id).order_by(ATTEMPTS.c.run)).tuples().all()
    return {run: seen for run, seen, _ in rows}, {run: text.splitlines() for run, _, text in rows if text}


def _files_of_newest(connection: Connection, chain: Chain, folders: Iterable[str]) -> dict[str, str]:
    """Return what was seen of every file of the newest runs, where they are concluded."""
    newest = list(folders)[-EVERY_FILE_OF:]
    asked = select(RUNS.c.run, RUNS.c.seen_files).where(RUNS.c.chain == chain.id, RUNS.c.run.in_(newest))
    return dict(connection.execute(asked).tuples().all())


def _compared(
    chain: Chain, stored: dict[str, str | None], files: dict[str, str], folders: dict[str, str]
) -> tuple[list[str], list[str]]:
    """Return the runs that must go into the store anew, and the folders that are none of its runs.

    Runs from before the chain, which are in no entry of it, are found here.
    """
    before = runs_before(chain)[0] if chain.there else set(folders)
    changed, strays = [], []
    for run, seen_now in folders.items():
        if run not in stored:
            strays += [] if run in before else [run]
        elif stored[run] not in (None, seen_now):
            changed.append(run)
    for run, was in files.items():
        if stored.get(run) == folders[run] and was != seen_files(RunRecord(chain.data / run)):
            changed.append(run)
    new = [run for run in before if run in folders and _new(chain, run, stored)]
    return [*changed, *new], strays


def _new(chain: Chain, run: str, stored: dict[str, str | None]) -> bool:
    """Whether a run from before the chain is not in the store yet, or was open when it came there and is no longer."""
    if run not in stored:
        return True
    if stored[run] is not None or chain.there:
        return False
    try:
        return is_sealed(RunRecord(chain.data / run).manifest())
    except RecordError:
        return False


def _named_in(data: Path, name: str) -> str | None:
    try:
        return RunRecord(data / name).manifest().id
    except RecordError:
        return None


def another_recipe(data: Path, name: str, revision: int, sha256: str, *, most_s: float) -> tuple[str, str] | None:
    """Return the newest run, and its recipe's hash, by a recipe of this name and revision but of other content.

    A store that is behind is brought up for a bounded time.

    Raises:
        StoreError: the store cannot be used.

    """
    chain = Chain(data)
    database = opened(data)
    try:
        if not catch_up(database, chain, most_s=most_s):
            _bring_in_older(database, chain, most_s)
        with database.reading() as connection:
            row = connection.execute(
                select(ATTEMPTS.c.run, RECIPES.c.sha256)
                .join(RECIPES, (RECIPES.c.chain == ATTEMPTS.c.chain) & (RECIPES.c.sha256 == ATTEMPTS.c.recipe_sha256))
                .where(
                    ATTEMPTS.c.chain == chain.id,
                    RECIPES.c.name == name,
                    RECIPES.c.revision == revision,
                    RECIPES.c.sha256 != sha256,
                )
                .order_by(ATTEMPTS.c.run.desc())
                .limit(1)
            ).first()
    finally:
        database.close()
    return None if row is None else (str(row[0]), str(row[1]))


def _bring_in_older(database: Database, chain: Chain, most_s: float) -> None:
    """Put runs from before the chain into a store that does not have them yet, for a bounded time."""
    older = runs_before(chain)[0] if chain.there else set(runs_there(chain.data))
    if not older:
        return
    end = time.monotonic() + most_s
    with database.reading() as connection:
        begun = set(connection.execute(select(ATTEMPTS.c.run).where(ATTEMPTS.c.chain == chain.id)).scalars())
    new = sorted(filter(is_text, older - begun), reverse=True)
    while new and time.monotonic() < end:
        put_runs(database, chain, new[:BATCH])
        new = new[BATCH:]


def bring_up(data: Path, most_s: float) -> int:
    """Bring a store up to its chain, for a bounded time; return how many runs are left.

    Raises:
        StoreError: the store cannot be used.

    """
    with closing(opened(data)) as database:
        return catch_up(database, Chain(data), most_s=most_s)


def keep_up(data: Path, most_s: float) -> int:
    """As `bring_up`, where nobody waits: a store that is up learns how big it is, which takes seconds now and then."""
    with closing(opened(data)) as database:
        left = catch_up(database, Chain(data), most_s=most_s)
        if not left:
            database.learn_sizes()
        return left
