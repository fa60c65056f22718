"""How big the tables of a plant are and how many rows share what, for the plans of the database.

Without being told SQLite takes a data folder to have some ten runs, and reads all of them for the hour or the serial
number that an index would find. Measured anew with every growth its plans would change; told once they stay.

PostgreSQL looks at each month by itself, and never at a table that is divided by months as a whole: it then expects
forty times the rows of a join, and the figures of a plant take half as long again.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

from sqlalchemy import Connection, text

from station.store.plant.months import DIVIDED
from station.store.tables import METADATA

MANY = 1_000_000

ROWS = {
    "metrics": 10 * MANY,
    "checks": 10 * MANY,
    "alarms": MANY // 10,
    "run_hours": MANY // 10,
    "cause_hours": MANY // 10,
    "runs_again": MANY // 10,
    "meanings": 100,
}
"""Rows of tables and of indexes of a part of one; of the others `MANY`."""

DIFFERENT = {
    "chain": 1, "run": MANY, "serial": MANY * 9 // 10, "hour": 20_000, "meaning": 10, "recipe": 5, "model": 5,
    "operator": 5, "started": MANY, "in_production": 1, "virtual": 1,
}  # fmt: skip
"""How many different values a column has; the others two."""


LEAST_ROWS = 10_000
"""Rows of a table from which on its plans matter."""

GREW = """
    SELECT p.relname FROM pg_class p
    JOIN pg_inherits i ON i.inhparent = p.oid JOIN pg_stat_user_tables s ON s.relid = i.inhrelid
    WHERE p.relname = ANY(:tables) AND pg_table_is_visible(p.oid)
    GROUP BY p.oid, p.relname, p.reltuples
    HAVING sum(s.n_live_tup) >= greatest(:least, 2 * p.reltuples)
    ORDER BY p.relname
"""
"""Tables that hold twice the rows of when PostgreSQL looked at them as a whole, or never did that (-1)."""


def grown(connection: Connection) -> list[str]:
    """Return the tables that PostgreSQL has to look at as a whole; none on SQLite."""
    if connection.dialect.name != "postgresql":
        return []
    return list(connection.execute(text(GREW), {"tables": list(DIVIDED), "least": LEAST_ROWS}).scalars())


def learn_sizes(connection: Connection, tables: Iterable[str]) -> None:
    """Have PostgreSQL look at tables as a whole, for some seconds in which nobody else has to wait."""
    if connection.dialect.name == "postgresql":
        for table in tables:
            connection.execute(text(f"ANALYZE {table}"))


def tell_sizes(connection: Connection) -> None:
    """Put the sizes where SQLite looks for them when it plans."""
    if connection.dialect.name != "sqlite":
        return
    connection.execute(text("ANALYZE projections"))  # the least of the tables: it makes the table of sizes
    connection.execute(text("DELETE FROM sqlite_stat1"))
    connection.execute(text("INSERT INTO sqlite_stat1 (tbl, idx, stat) VALUES (:table, :index, :sizes)"), _size_rows())
    connection.execute(text("ANALYZE sqlite_schema"))


@cache
def _size_rows() -> list[dict[str, str]]:
    """Return the sizes of every table and index: the same for each new store."""
    rows = []
    for table in METADATA.sorted_tables:
        keys = {table.name: [column.name for column in table.primary_key]}
        keys |= {str(index.name): [column.name for column in index.columns] for index in table.indexes}
        for name, columns in keys.items():
            number = ROWS.get(name, ROWS.get(table.name, MANY))
            rows.append({"table": table.name, "index": name, "sizes": _sizes(number, columns)})
    return rows


def _sizes(rows: int, columns: list[str]) -> str:
    """Return the number of rows, and of those that share the first column, the first two, and so on."""
    shared, found = rows, [rows]
    for column in columns:
        shared = max(1, shared // DIFFERENT.get(column, 2))
        found.append(shared)
    return " ".join(map(str, found))
