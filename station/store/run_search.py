"""Runs of a data folder as a person looks for them: a page of rows at a time, newest first, whatever the folder holds.

A look at the whole folder compares every run with its folder, which takes longer the more there are. Here only the rows
that are shown are compared: one whose files have changed is held against its hashes and goes into the store anew, as
after a restore; one that was altered, or is missing, has no verdict.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from station.records.chain.chain_file import Chain
from station.records.chain.walk import trust_of
from station.records.run_record import MANIFEST, RunRecord
from station.store.attempts import attempts_told, not_passed
from station.store.outbox import catch_up, put_runs
from station.store.plant.removals import removals_now
from station.store.rows.projection import seen, seen_files
from station.store.stored_runs import Span, StoredRun, Wanted, believed, newest_meant, number_of, runs_named, total_of
from station.store.view import opened

MOST_ROWS = 500
MISSING = "its folder is missing"
REMOVED_BY = "its record was removed by the retention rule {}"
CATCH_UP_S = 0.1
"""Longest time for putting runs into the store that have come since: those of a line that is watched."""


@dataclass(frozen=True)
class Page:
    """Some of the runs that are meant, newest first, how many there are, and all recipes and models of the folder.

    A row whose record is not as it was left has no verdict, and `altered` says why. behind: runs that are in the folder
    and not in the store yet, so that they were not looked for.
    """

    rows: tuple[StoredRun, ...]
    total: int
    recipes: tuple[str, ...]
    models: tuple[str, ...]
    behind: int
    attempts: dict[str, str]
    """Which attempt each row is, and what became of those before, by its run."""
    not_passed: dict[str, tuple[str, ...]]
    """Titles of the metrics that failed, or left it not decidable, of each such row that is believed, by its run."""


def search(data: Path, wanted: Wanted, *, first: int = 0, count: int = 100) -> Page:
    """Return `count` of the runs that are meant, from the `first` newest on; `count` at most `MOST_ROWS`.

    Raises:
        StoreError, RecordError: the store cannot be used, or the chain not be read.

    """
    chain = Chain(data)
    database = opened(data)
    try:
        behind = catch_up(database, chain, most_s=CATCH_UP_S)
        # First how many, and which ones, in an index that holds all that is asked for; then the rows of those.
        with database.reading() as connection:
            total = total_of(connection, chain)
            number = number_of(connection, chain, wanted, total)
            span = Span(first, min(count, MOST_ROWS))
            named = newest_meant(connection, chain, wanted, span, number=number, total=total)
            rows = runs_named(connection, chain, named)
        now = {run: _seen_now(chain, run) for run in rows}
        changed = [run for run, row in rows.items() if now[run][0] and now[run] != (row.seen, row.seen_files)]
        if changed:
            put_runs(database, chain, changed)
        trust = trust_of(chain)
        gone = [run for run, (seen_now, _) in now.items() if not seen_now]
        with database.reading() as connection:
            rows = runs_named(connection, chain, named) if changed else rows
            rules = removals_now(connection, chain, trust, gone, behind) if gone else {}
            attempts = attempts_told(connection, chain, trust, rows.values())
            why_not = not_passed(connection, chain, rows.values())
    finally:
        database.close()
    why = {run: REMOVED_BY.format(rules[run]) if run in rules else MISSING for run in gone}
    shown = [rows[run]._replace(altered=why[run]) if run in why else rows[run] for run in named if run in rows]
    told = tuple(believed(one, chain, trust) for one in shown)
    why_not = {one.run: why_not[one.run] for one in told if one.verdict and one.run in why_not}
    return Page(told, number, total.recipes, total.models, behind, attempts, why_not)


def _seen_now(chain: Chain, run: str) -> tuple[str, str]:
    """Return what is seen of the files of a run as they are now, nothing where it is not there."""
    found = seen(str(chain.data / run / MANIFEST))
    return (found, seen_files(RunRecord(chain.data / run))) if found else ("", "")
