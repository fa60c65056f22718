"""How much a store holds of a data folder, and what of the chain it lacks."""

from __future__ import annotations

from typing import Any

from sqlalchemy import func, select

from station.records.chain.chain_file import Chain
from station.store import tables
from station.store.engine import Database
from station.store.outbox import stored_walk


def counts(database: Database, chain: Chain) -> dict[str, int]:
    """Return the rows of every table that are of this data folder."""
    with database.reading() as connection:
        return {
            table.name: connection.execute(
                select(func.count()).select_from(table).where(table.c.chain == chain.id)
            ).scalar_one()
            for table in tables.METADATA.sorted_tables
        }


def behind(database: Database, chain: Chain) -> int:
    """Return how many entries of the chain are not in the store."""
    with database.reading() as connection:
        place = stored_walk(connection, chain).place
    return chain.content.count(b"\n", place.offset)


def all_rows(database: Database, chain: Chain) -> dict[str, list[tuple[Any, ...]]]:
    """Return every row of a data folder, in the order of the tables' keys: what two stores are compared by."""
    with database.reading() as connection:
        return {
            table.name: [
                tuple(row)
                for row in connection.execute(
                    select(table).where(table.c.chain == chain.id).order_by(*table.primary_key.columns)
                )
            ]
            for table in tables.METADATA.sorted_tables
        }
