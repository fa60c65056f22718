"""The chain of runs read on by an outbox: each run that was sealed since its last look, once, whoever dies.

What is made of the runs is written in the transaction that notes how far the chain was read. So a kill at any moment
loses none and makes none twice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from sqlalchemy import Connection, Table, insert, select, update

from station.records.chain.entries import Fields
from station.results.sealed_runs import chain_end, sealed_since
from station.web.people.database import StationDatabase

Made = TypeVar("Made")


def begin_at_the_end(connection: Connection, read: Table, data: Path) -> None:
    """Note where the chain ends, once: what was sealed before an outbox was set up is not for it.

    read: table of one row with the place up to which the chain was read. Raises StationError: the chain cannot be read.
    """
    if connection.execute(select(read.c.offset)).first() is None:
        connection.execute(insert(read).values(number=1, offset=chain_end(data)))


def read_on(
    database: StationDatabase, data: Path, read: Table, make: Callable[[Fields], Made],
    write: Callable[[Connection, Sequence[tuple[Fields, Made]]], object], *, always: bool = False,
) -> list[tuple[Fields, Made]]:  # fmt: skip
    """Return the entries of runs that were sealed since the last look with what is made of each, written by now.

    make: before the transaction. write: in it. always: also where there is no new entry. Nothing is returned, and
    nothing written, where somebody else has read on meanwhile.

    Raises:
        StationError: the chain or the database cannot be read.

    """
    with database.reading() as connection:
        offset = connection.execute(select(read.c.offset)).scalar() or 0
    sealed, end = sealed_since(data, offset)
    if end == offset and not always:
        return []
    made = [(fields, make(fields)) for fields in sealed]
    with database.writing() as connection:
        taken = update(read).where(read.c.offset == offset).values(offset=end)
        if not connection.execute(taken).rowcount:
            return []
        write(connection, made)
    return made
