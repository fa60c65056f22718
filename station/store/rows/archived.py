"""Where archived runs are, as rows of the store: made again from the note of the data folder."""

from __future__ import annotations

from sqlalchemy import Connection, delete, insert, select

from station.records.archive_note import Note, read_note
from station.records.chain.chain_file import Chain
from station.store.engine import Database
from station.store.tables import ARCHIVED, Row

ROWS_AT_ONCE = 5_000


def put_archived(connection: Connection, chain: Chain) -> None:
    """Put the addresses of a data folder's archived runs in the place of those that are there.

    Raises:
        RecordError: the note cannot be read; what is there stays.

    """
    rows = _rows(read_note(chain.data), chain.id)
    connection.execute(delete(ARCHIVED).where(ARCHIVED.c.chain == chain.id))
    for begin in range(0, len(rows), ROWS_AT_ONCE):
        connection.execute(insert(ARCHIVED), rows[begin : begin + ROWS_AT_ONCE])


def bring_up_archived(database: Database, chain: Chain) -> int:
    """Bring the addresses in a store up to the note; return how many there are.

    Raises:
        StoreError: the store cannot be used. RecordError: as `put_archived`.

    """
    with database.writing() as connection:
        put_archived(connection, chain)
        return len(list(connection.execute(select(ARCHIVED.c.run).where(ARCHIVED.c.chain == chain.id)).scalars()))


def _rows(note: Note, chain: str) -> list[Row]:
    return [
        {
            "chain": chain,
            "run": run,
            "sha256": address.run.sha256,
            "url": address.line.url,
            "object": address.line.full.name,
            "object_sha256": address.line.full.sha256,
            "row_group": address.run.group,
            "trace_object": None if address.line.trace is None else address.line.trace.name,
            "trace_row_group": address.run.trace,
            "trace_sha256": address.run.trace_sha256,
            "verified": address.line.verified,
        }
        for run, address in sorted(note.runs.items())
    ]
