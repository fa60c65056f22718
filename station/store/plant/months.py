"""Months of the big tables on PostgreSQL, each a partition of its own, made by whoever writes; SQLite has one table.

The tables are divided by the id of a run, which begins with the moment of its start in UTC and stands in every key: so
all keys hold over all months. Runs that are named in another way are in the partition for what is in no month.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress

from sqlalchemy import Connection, text
from sqlalchemy.exc import DBAPIError

DIVIDED = ("runs", "metrics", "checks")
"""Tables with most rows."""

REST = "rest"
"""End of the name of the partition for what is in no month."""

MONTH = re.compile(r"2[01]\d\d(?:0[1-9]|1[0-2])(?=\d\dT)")
"""How the id of a run begins that a clock named, from 2000 to 2199."""

DECEMBER = 12

THERE = text("SELECT name FROM unnest(CAST(:names AS text[])) name WHERE to_regclass(name) IS NOT NULL")
"""Which of some tables there are."""


def make_rest(connection: Connection, *tables: str) -> None:
    """Make the partitions of new tables for what is in no month; of all of them by default."""
    if connection.dialect.name == "postgresql":
        for table in tables or DIVIDED:
            connection.execute(text(f"CREATE TABLE {table}_{REST} PARTITION OF {table} DEFAULT"))


def make_months(connection: Connection, runs: Iterable[str], *tables: str) -> None:
    """Make the months that runs are of, and the ones after: so that a run finds its month there when it begins.

    tables: those that are divided; all of them by default.

    A month ahead that somebody's long look keeps from being made is made by a later writer.
    """
    if connection.dialect.name != "postgresql":
        return
    needed = {found[0] for run in runs if (found := MONTH.match(run))}
    asked = sorted(needed | {_next(month) for month in needed})
    names = [f"{table}_{month}" for month in asked for table in tables or DIVIDED]
    there = connection.execute(THERE, {"names": names}).scalars()
    missing = sorted(set(names) - set(there))
    for name in missing:
        if name[-6:] in needed:
            _make(connection, name)
    for name in missing:
        if name[-6:] not in needed:
            with suppress(DBAPIError), connection.begin_nested():
                _make(connection, name)


def is_partition(name: str) -> bool:
    """Whether a table is a part of another one."""
    table, _, rest = name.rpartition("_")
    return table in DIVIDED and (rest == REST or rest.isdecimal())


def _make(connection: Connection, name: str) -> None:
    table, _, month = name.rpartition("_")
    bounds = f"FROM ('{month}') TO ('{int(month) + 1}')"  # the thirteenth month is after all days of December
    connection.execute(text(f"CREATE TABLE IF NOT EXISTS {name} PARTITION OF {table} FOR VALUES {bounds}"))


def _next(month: str) -> str:
    year, number = int(month[:4]), int(month[4:])
    return f"{year + number // DECEMBER}{number % DECEMBER + 1:02}"
