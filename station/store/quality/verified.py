"""What `lostmotion verify` found, told to the store: the runs whose records are not as the store has them.

A look at the whole folder compares few files of old runs, and questions that ask the store alone none at all. Who has
just read every byte of every run lets both know.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from sqlalchemy import select

from station.records.chain.chain_file import Chain
from station.store.outbox import catch_up, put_runs
from station.store.places import store_is_there
from station.store.tables import RUNS
from station.store.view import opened
from station.there import is_folder


def tell_store(data: Path, altered: Collection[str], *, samples: bool) -> None:
    """Put the runs that were found altered into the store anew, and those that are as they were again.

    A data folder without a store has nobody to tell: none is made.

    altered: runs that were found altered or damaged. samples: whether every byte of the samples was compared.

    Raises:
        StoreError: the store cannot be used. RecordError: the chain cannot be read.

    """
    if not store_is_there(data):
        return
    database, chain = opened(data), Chain(data)
    try:
        catch_up(database, chain)
        known = select(RUNS.c.run, RUNS.c.altered).where(RUNS.c.chain == chain.id)
        with database.reading() as connection:
            rows = dict(connection.execute(known).tuples().all())
        found = set(altered)
        # Of samples whose size alone was looked at, nobody can say that they are as they were again.
        other = {run for run, text in rows.items() if bool(text) != (run in found) and (run in found or samples)}
        put_runs(database, chain, [run for run in other if is_folder(data / run) is not False], samples=samples)
    finally:
        database.close()
