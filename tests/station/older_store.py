"""A store as an older version of the program left it: what migrations meet."""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import Column, Connection, MetaData, Table, inspect, select, text

from station.store import engine
from station.store.engine import VERSIONS
from station.store.plant.meanings import Meaning, meaning_of_metrics
from station.store.tables import CAUSE_HOURS, MEANINGS, METADATA, METRIC_HOURS, METRICS, REMOVALS, RUN_HOURS

NEW = (RUN_HOURS, METRIC_HOURS, CAUSE_HOURS, REMOVALS, MEANINGS)
OLD = [table for table in METADATA.sorted_tables if table not in NEW]
"""Tables that version 0005 has."""


def to_version_0005(connection: Connection) -> None:
    """Make the tables of version 0005 of those of today, with the rows that they would have."""
    from alembic import command  # noqa: PLC0415 - for these tests alone
    from alembic.config import Config  # noqa: PLC0415

    worded = METRICS.join(MEANINGS, meaning_of_metrics())
    asked = {table: select(table) for table in OLD}
    asked[METRICS] = select(*METRICS.c, *(MEANINGS.c[name] for name in Meaning._fields)).select_from(worded)
    rows = {table: [dict(row) for row in connection.execute(one).mappings()] for table, one in asked.items()}
    METADATA.drop_all(connection)
    connection.execute(text(f"DROP TABLE {VERSIONS}"))
    config = Config()
    config.set_main_option("script_location", str(Path(engine.__file__).parent / "migrations"))
    config.attributes["connection"] = connection
    command.upgrade(config, "0005")
    for table, content in rows.items():
        there = {str(one["name"]): one["type"] for one in inspect(connection).get_columns(table.name)}
        kinds = {column.name: column.type for column in table.c}
        if content:
            columns = (Column(name, kinds.get(name, kind)) for name, kind in there.items())
            kept = Table(table.name, MetaData(), *columns)
            connection.execute(kept.insert(), [{name: row[name] for name in there} for row in content])
