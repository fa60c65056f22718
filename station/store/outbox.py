"""From the chain to the store: the chain is the outbox, and the store remembers how far it has come.

A run is in the chain before anybody sees its verdict. So whoever is killed between seal and store, or finds the store
locked, full or gone, loses nothing: the next one that looks brings the store up to the chain. Doing that twice changes
nothing.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Collection
from contextlib import suppress

from sqlalchemy import Connection, RowMapping, delete, insert, select, update

from station.errors import RecordError
from station.records.chain.chain_file import Chain, folder_id
from station.records.chain.problems import PROBLEMS, Problem
from station.records.chain.walk import Place, Walk, walk
from station.records.run_record import MANIFEST, RunRecord
from station.store.engine import REBUILD, Database, StoreError
from station.store.plant.removals import put_removals
from station.store.rows.archived import put_archived
from station.store.rows.projection import put_runs_apart, remove_chain, remove_rows, rows_of
from station.store.tables import ATTEMPTS, PROJECTIONS, REMOVALS, RUNS

BATCH = 100
"""Runs that are put into the store at a time: they are kept together, and others may write between two batches."""

MOST_TRIES = 5
"""How often a store is brought up that another process makes again at the same time."""

FEW = 5
"""Runs up to which their lines are looked for in the chain; for more of them it is gone through once."""

SEALED_LINE = b'\n{"kind":"sealed"'
"""How a line begins that concludes a run, with the end of the line before it."""

Told = Callable[[int, int], None]
Warned = Callable[[str], None]


def catch_up(
    database: Database,
    chain: Chain,
    *,
    most_s: float | None = None,
    told: Told | None = None,
    warned: Warned | None = None,
) -> int:
    """Bring the store up to the chain; return how many runs it is still behind.

    Args:
        database: the store.
        chain: of the data folder; one that was read just now.
        most_s: time after which no further batch is begun; None: until all is there.
        told: is called with the runs that are done and those that there are.
        warned: is called with what could not be put in, beside the runs.

    Raises:
        StoreError: the store cannot be used; what was put into it stays.
        RecordError: the chain cannot be read.

    """
    if not chain.there:
        return 0
    read = _ReadSoFar(chain)
    with database.reading() as connection:
        row = _projection(connection, chain)
    if row is not None:
        if row["seen"] and row["seen"] == chain.seen_now():
            return 0  # without reading the file: a hundred megabytes where it has a few hundred thousand lines
        end_of_lines = chain.content.rfind(b"\n") + 1
        if row["offset"] == end_of_lines and row["prefix_sha256"] == read.sha256(end_of_lines):
            _keep_seen(database, chain)
            return 0
    end = None if most_s is None else time.monotonic() + most_s
    done, before = 0, -1
    while True:
        with database.writing() as connection:
            left, offset = _one_batch(connection, chain, read, warned)
        done += BATCH
        if told is not None and left:
            told(done, done + left)
        # A batch that comes no further than the one before it would be the same for ever.
        if not left or offset == before or (end is not None and time.monotonic() > end):
            return left
        before = offset


def hold_up(
    database: Database, chain: Chain, *, most_s: float | None = None, told: Told | None = None,
    warned: Warned | None = None,
) -> int:  # fmt: skip
    """Hold a store that was brought up to the chain as it is then; return how many runs it is behind none the less.

    Between the two another process may take all rows out to make them again: figures of those that are there by then
    would be figures of some runs. Then the store is brought up once more; arguments as of `catch_up`.

    Raises:
        StoreError, RecordError: as `catch_up`; or it is made again all the time.

    """
    for _ in range(MOST_TRIES):
        database.hold()
        with database.reading() as connection:
            if _is_up(connection, chain):
                return 0
        database.let_go()
        behind = catch_up(database, chain, most_s=most_s, told=told, warned=warned)
        if behind:
            database.hold()
            return behind
    raise StoreError(
        f"{database.place.shown}: another process is making the store of runs again. Wait until it has ended, then run "
        "the command again"
    )


def _is_up(connection: Connection, chain: Chain) -> bool:
    """Whether all that is known of a chain is in the store."""
    if not chain.there:
        return True
    row = _projection(connection, chain)
    if row is None:
        return False
    up = bool(row["seen"]) and row["seen"] == chain.seen_now()
    return up or int(row["offset"]) > chain.content.rfind(b"\n")


class _ReadSoFar:
    """Of the beginning of a chain's file, the hash, and of its rest the number of sealed runs.

    Batch after batch both go on from where they were: from the start each time, they would take longer than the runs.
    """

    def __init__(self, chain: Chain) -> None:
        self._chain = chain
        self._hash, self._at = hashlib.sha256(), 0
        self._left: int | None = None
        self._left_at = 0

    def sha256(self, offset: int) -> str:
        """Return the SHA-256 of the file up to an offset."""
        if offset < self._at:
            self._hash, self._at = hashlib.sha256(), 0
        self._hash.update(memoryview(self._chain.content)[self._at : offset])
        self._at = offset
        return self._hash.hexdigest()

    def sealed_behind(self, offset: int) -> int:
        """Return how many lines behind an offset, where a line begins, conclude a run."""
        content, at = self._chain.content, max(offset - 1, 0)
        if self._left is None:  # what stands behind the last end of a line is none: it is being written, or was torn
            self._left = content.count(SEALED_LINE, at, content.rfind(b"\n") + 1)
        else:
            low, high = sorted((self._left_at, at))
            between = content.count(SEALED_LINE, low, high + len(SEALED_LINE) - 1)
            self._left += between if at < self._left_at else -between
        self._left_at = at
        return self._left


def put_runs(database: Database, chain: Chain, runs: Collection[str], *, samples: bool = False) -> None:
    """Put single runs into the store anew: their folders have changed, or were there before the chain.

    samples: compare every byte of the samples, and not their size alone.
    """
    if len(runs) > FEW:
        chain.index()
    names = sorted(runs)
    for begin in range(0, len(names), BATCH):
        with database.writing() as connection:
            folders = [RunRecord(chain.data / name) for name in names[begin : begin + BATCH]]
            # What a run was whose run.json is gone, the chain still says: only one that it does not name is forgotten.
            rows = {
                run.id: rows_of(run, chain, samples=samples) if run.has(MANIFEST) or chain.entries_of(run.id) else {}
                for run in folders
            }
            put_runs_apart(connection, chain, rows)


def remove_runs(database: Database, chain: Chain, runs: Collection[str]) -> None:
    """Take runs out of the store whose folders are gone, where no chain has anything to say of them.

    How far a chain of this name was in it goes with them: should it come back, all of it is put in again.
    """
    if runs:
        with database.writing() as connection:
            remove_rows(connection, chain, list(runs))
            connection.execute(delete(PROJECTIONS).where(PROJECTIONS.c.chain == chain.id))


def rebuild(database: Database, chain: Chain, told: Told | None = None, warned: Warned | None = None) -> None:
    """Make the rows of a data folder again, from its chain; the next look puts in what was there before the chain."""
    with database.writing() as connection:
        remove_chain(connection, chain.id)
    catch_up(database, chain, told=told, warned=warned)
    database.learn_sizes(anew=True)


def stored_walk(connection: Connection, chain: Chain) -> Walk:
    """Return what was found in the chain up to where the store has it."""
    row = _projection(connection, chain)
    if row is None:
        return Walk()
    found = Walk(Place(row["offset"], row["counter"], row["sha256"]))
    found.problems = [Problem(*one) for one in row["problems"]]
    found.keys.update(row["keys"])
    return found


def _projection(connection: Connection, chain: Chain) -> RowMapping | None:
    """Return how far a chain is in the store, None where it never was; StoreError where that row is damaged."""
    row = connection.execute(select(PROJECTIONS).where(PROJECTIONS.c.chain == chain.id)).mappings().first()
    if row is None or _is_sound(row):
        return row
    raise StoreError(f"{chain.data}: the store of runs is damaged: what it says of the chain is nothing. {REBUILD}")


def _is_sound(row: RowMapping) -> bool:
    numbers, texts = (row["offset"], row["counter"]), (row["sha256"], row["prefix_sha256"], row["seen"])
    problems, keys = row["problems"], row["keys"]
    return (
        all(isinstance(one, int) and one >= 0 for one in numbers)
        and all(isinstance(one, str) for one in texts)
        and isinstance(problems, list)
        and all(isinstance(one, list) and len(one) == len(Problem._fields) for one in problems)
        and all(isinstance(word, str) for one in problems for word in one)
        and all(one[0] in PROBLEMS for one in problems)
        and isinstance(keys, dict)
        and all(isinstance(one, int) for one in keys.values())
    )


def _keep_seen(database: Database, chain: Chain) -> None:
    """Note how the file looks of which all is in the store: it was copied or restored, and has the same bytes."""
    if chain.seen:
        with suppress(StoreError), database.writing() as connection:  # one that cannot be written is read again
            connection.execute(update(PROJECTIONS).where(PROJECTIONS.c.chain == chain.id).values(seen=chain.seen))


def _one_batch(connection: Connection, chain: Chain, read: _ReadSoFar, warned: Warned | None) -> tuple[int, int]:
    """Put the next runs of the chain into the store; return how many are left, and how far the store has come.

    None are left only at the end of the chain; how far: bytes of its file.
    """
    row = _projection(connection, chain)
    begin, before = Place(), Walk()
    if row is not None and read.sha256(row["offset"]) == row["prefix_sha256"]:
        begin, before = Place(row["offset"], row["counter"], row["sha256"]), stored_walk(connection, chain)
    limit = _end_of_batch(chain, begin.offset)
    found = walk(chain, begin, limit)
    named = list(dict.fromkeys((*found.created, *found.sealed)))
    if begin.offset == 0:
        stored = _entries_there(connection, chain)
        remove_chain(connection, folder_id(chain.data))  # from before the chain: they are put in again
        known = set(chain.runs()) | set(() if chain.before is None else chain.before.unconcluded)
        named_then = _begun_there(connection, chain).union(run for run, entry in stored.items() if entry)
        remove_rows(connection, chain, sorted(named_then - known))
        try:
            put_archived(connection, chain)
        except RecordError as error:  # the runs themselves do not rest on the note
            if warned is not None:
                warned(f"{error}. Until then the store does not learn which runs are archived")
        connection.execute(delete(REMOVALS).where(REMOVALS.c.chain == chain.id))
    else:
        stored = _entries_there(connection, chain, named)
    put_removals(connection, chain, found.removed)
    runs = [
        RunRecord(chain.data / run)
        for run in named
        if run not in found.sealed or stored.get(run) != found.sealed[run][-1].sha256
    ]
    if len(runs) > FEW:
        chain.index()
    put_runs_apart(connection, chain, {run.id: rows_of(run, chain) for run in runs})
    whole = {
        "chain": chain.id,
        "offset": found.place.offset,
        "counter": found.place.counter,
        "sha256": found.place.sha256,
        "prefix_sha256": read.sha256(found.place.offset),
        "problems": [list(problem) for problem in (*before.problems, *found.problems)],
        "keys": dict(before.keys + found.keys),
        "seen": chain.seen if found.place.offset == len(chain.content) else "",
    }
    connection.execute(PROJECTIONS.delete().where(PROJECTIONS.c.chain == chain.id))
    connection.execute(insert(PROJECTIONS), [whole])
    # Lines that conclude no run may be left alone, as those of removed runs: they count as one run that is left.
    left = read.sealed_behind(found.place.offset) or int(chain.content.rfind(b"\n") >= found.place.offset)
    return left, found.place.offset


def _entries_there(connection: Connection, chain: Chain, runs: Collection[str] | None = None) -> dict[str, str | None]:
    """Return the hash of the line that concluded each of these runs, as far as the store has it; None: of all."""
    asked = select(RUNS.c.run, RUNS.c.entry_sha256).where(RUNS.c.chain == chain.id)
    rows = connection.execute(asked if runs is None else asked.where(RUNS.c.run.in_(runs)))
    return dict(rows.tuples().all())


def _begun_there(connection: Connection, chain: Chain) -> set[str]:
    """Return the runs in the store that a line of the chain has begun, concluded or not."""
    begun = select(ATTEMPTS.c.run).where(ATTEMPTS.c.chain == chain.id, ATTEMPTS.c.counter.is_not(None))
    return set(connection.execute(begun).scalars())


def _end_of_batch(chain: Chain, offset: int) -> int:
    """Return where the file's line ends with which a batch ends."""
    at = offset
    for _ in range(2 * BATCH):
        end = chain.content.find(b"\n", at)
        if end < 0:
            break
        at = end + 1
    return at
