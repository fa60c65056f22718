"""What metrics mean by a number, in a table of its own; fixture and lock angle of a run.

No record from before says either of these two, so a store that is made anew has none of them for its runs either.
"""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

from station.store.plant.meanings import Meaning, number_of
from station.store.plant.months import MONTH, make_months, make_rest
from station.store.plant.sizes import tell_sizes

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

TEXTS = ("metric", "choices", "branch", "definition", "estimator", "band", "torque_nm", "unit")

KEPT = (
    "chain", "run", "position", "side", "main", "cycles", "value", "uncertainty", "coverage_factor", "limit_min",
    "limit_max", "verdict",
)  # fmt: skip
"""Columns of the metrics that stay."""

QUALITY = (
    "chain", "in_production", "virtual", "run", "attempt", "key", "state", "verdict", "valid", "serial", "recipe",
    "revision", "model", "bench", "operator", "started", "hour", "fixture", "lock_angle_deg",
)  # fmt: skip
AGAIN = (
    "chain", "in_production", "virtual", "serial", "run", "attempt", "key", "state", "verdict", "recipe", "revision",
    "model", "bench", "operator", "started", "hour", "fixture", "lock_angle_deg",
)  # fmt: skip


def upgrade() -> None:
    """Bring the tables to this version."""
    connection = op.get_bind()
    text: sa.Text = sa.Text(collation="C") if connection.dialect.name == "postgresql" else sa.Text()
    op.create_table(
        "meanings",
        sa.Column("chain", text, primary_key=True),
        sa.Column("meaning", sa.BigInteger(), primary_key=True, autoincrement=False),
        *(sa.Column(name, text, nullable=False) for name in TEXTS),
        sqlite_with_rowid=False,
    )
    _fill_meanings(connection)
    _number_metrics(connection, text)
    op.add_column("runs", sa.Column("fixture", text, nullable=False, server_default=""))
    op.add_column("runs", sa.Column("lock_angle_deg", sa.Double()))
    where: sa.ColumnElement[bool] = sa.literal_column("again")
    op.drop_index("runs_quality", "runs")
    op.create_index("runs_quality", "runs", list(QUALITY))
    op.drop_index("runs_again", "runs")
    op.create_index("runs_again", "runs", list(AGAIN), sqlite_where=where, postgresql_where=where)
    _make_hours(text)
    tell_sizes(connection)  # the hours are counted when their tables are those of today: see v0010


def _said(name: str, table: str) -> str:
    return f"COALESCE({table}.{name}, '')"


def _fill_meanings(connection: sa.Connection) -> None:
    texts = ", ".join(_said(name, "metrics") for name in TEXTS)
    there = connection.execute(sa.text(f"SELECT DISTINCT chain, {texts} FROM metrics")).tuples().all()  # noqa: S608
    rows = [
        {"chain": chain, "meaning": number_of(Meaning(*said)), **dict(zip(TEXTS, said, strict=True))}
        for chain, *said in there
    ]
    columns = ("chain", "meaning", *TEXTS)
    table = sa.table("meanings", *(sa.column(name) for name in columns))
    if rows:
        connection.execute(table.insert(), rows)


def _number_metrics(connection: sa.Connection, text: sa.Text) -> None:
    """Make the metrics anew with a number instead of their texts: a column cannot be put in front of others."""
    divided = connection.dialect.name == "postgresql"
    op.execute("ALTER TABLE metrics RENAME TO metrics_worded")
    op.execute("DROP INDEX metrics_metric")
    columns: list[sa.Column[Any]] = [
        sa.Column("chain", text, primary_key=True),
        sa.Column("run", text, primary_key=True),
        sa.Column("position", sa.Integer(), primary_key=True, autoincrement=False),
        sa.Column("side", text, primary_key=True),
        sa.Column("main", sa.Boolean(), nullable=False),
        sa.Column("meaning", sa.BigInteger(), nullable=False),
        sa.Column("cycles", sa.Integer()),
        *(sa.Column(name, sa.Double()) for name in KEPT[KEPT.index("value") : KEPT.index("verdict")]),
        sa.Column("verdict", text),
    ]
    if divided:
        _out_of_the_way(connection)
    op.create_table("metrics", *columns, sqlite_with_rowid=False, postgresql_partition_by="RANGE (run)")
    if divided:
        runs = connection.execute(sa.text("SELECT DISTINCT substr(run, 1, 9) FROM metrics_worded")).scalars().all()
        make_rest(connection, "metrics")
        make_months(connection, [run for run in runs if MONTH.match(run)], "metrics")
    same = " AND ".join(f"n.{name} = {_said(name, 'm')}" for name in TEXTS)
    kept = ", ".join(KEPT)
    op.execute(
        f"INSERT INTO metrics ({kept}, meaning) SELECT {', '.join(f'm.{name}' for name in KEPT)}, n.meaning "  # noqa: S608 - its own
        f"FROM metrics_worded m JOIN meanings n ON n.chain = m.chain AND {same}"
    )
    op.execute("DROP TABLE metrics_worded")
    op.create_index("metrics_meaning", "metrics", ["chain", "meaning", "run", "side", "main", "position", "value"])


def _out_of_the_way(connection: sa.Connection) -> None:
    """Give the months of the table that goes, and its key, other names: the new one's have theirs."""
    parts = sa.text("SELECT inhrelid::regclass::text FROM pg_inherits WHERE inhparent = 'metrics_worded'::regclass")
    for part in connection.execute(parts).scalars().all():
        op.execute(f"ALTER TABLE {part} RENAME TO worded_{part}")
        op.execute(f"ALTER INDEX IF EXISTS {part}_pkey RENAME TO worded_{part}_pkey")
    op.execute("ALTER INDEX metrics_pkey RENAME TO metrics_worded_pkey")


def _make_hours(text: sa.Text) -> None:
    def keys(*names: str) -> list[sa.Column[str]]:
        return [sa.Column(name, text, primary_key=True) for name in names]

    def flags(*names: str) -> list[sa.Column[bool]]:
        return [sa.Column(name, sa.Boolean(), primary_key=True) for name in names]

    op.drop_table("run_hours")
    op.drop_table("metric_hours")
    op.create_table(
        "run_hours",
        *keys("chain", "hour", "bench", "recipe"),
        sa.Column("revision", sa.Integer(), primary_key=True, autoincrement=False),
        *keys("model", "operator", "key", "fixture", "state", "verdict", "master"),
        *flags("virtual", "in_production", "valid", "first"),
        sa.Column("runs", sa.Integer(), nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "metric_hours",
        *keys("chain"),
        sa.Column("meaning", sa.BigInteger(), primary_key=True, autoincrement=False),
        *keys("side", "hour", "bench", "recipe"),
        sa.Column("revision", sa.Integer(), primary_key=True, autoincrement=False),
        *keys("model", "operator", "key", "fixture"),
        *flags("virtual"),
        sa.Column("number", sa.Integer(), nullable=False),
        *(sa.Column(name, sa.Double(), nullable=False) for name in ("mean", "squares")),
        sa.Column("failed", sa.Integer(), nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_index("metric_hours_hour", "metric_hours", ["chain", "hour"])
