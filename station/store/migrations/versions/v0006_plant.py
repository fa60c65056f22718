"""Runs, metrics and checks in months on PostgreSQL, counts and sums by the hour, texts ordered by their characters."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from station.store.plant.months import make_months, make_rest
from station.store.plant.sizes import tell_sizes

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

DIVIDED = {"runs": ("run",), "metrics": ("run", "position", "side"), "checks": ("run", "id")}
"""Tables in months, with their keys, which begin with the chain."""

QUALITY = (
    "chain", "in_production", "virtual", "run", "attempt", "key", "state", "verdict", "valid", "serial", "recipe",
    "revision", "model", "bench", "operator", "started", "hour",
)  # fmt: skip
SEARCH = ("chain", "run", "serial", "model", "recipe", "verdict", "operator", "started", "master")

VALUES = ("chain", "metric", "run", "side", "main", "position", "value")

INDEXES = {
    "runs_recipe": ("runs", ("chain", "recipe")),
    "runs_serial": ("runs", ("chain", "serial")),
    "runs_model": ("runs", ("chain", "model")),
    "runs_search": ("runs", SEARCH),
    "runs_quality": ("runs", QUALITY),
    "metrics_metric": ("metrics", VALUES),
}
"""Indexes of the tables in months."""

AGAIN = (
    "chain", "in_production", "virtual", "serial", "run", "attempt", "key", "state", "verdict", "recipe", "revision",
    "model", "bench", "operator", "started", "hour",
)  # fmt: skip

MEASURED_AGAIN = """
UPDATE runs SET again = EXISTS (
    SELECT 1 FROM runs other WHERE other.chain = runs.chain AND other.serial = runs.serial AND other.attempt > 1
)
"""


def upgrade() -> None:
    """Bring the tables to this version; a database in months is filled from the tables that it had, and these go."""
    connection = op.get_bind()
    divided = connection.dialect.name == "postgresql"
    text = sa.Text(collation="C") if divided else sa.Text()
    op.add_column("runs", sa.Column("hour", text, nullable=False, server_default=""))
    op.add_column("runs", sa.Column("again", sa.Boolean(), nullable=False, server_default=sa.false()))
    op.execute("UPDATE runs SET hour = COALESCE(substr(started, 1, 13), '')")
    if divided:
        _order_texts(connection)
        runs = connection.execute(sa.text(" UNION ".join(f"SELECT substr(run, 1, 9) FROM {one}" for one in DIVIDED)))  # noqa: S608
        months = list(runs.scalars())
        for table, key in DIVIDED.items():
            _divide(connection, table, key, months)
        for name, (table, columns) in INDEXES.items():
            op.create_index(name, table, list(columns))
    else:
        for name in ("runs_quality", "metrics_metric"):
            table, columns = INDEXES[name]
            op.drop_index(name, table)
            op.create_index(name, table, list(columns))
    op.create_index("runs_hour", "runs", ["chain", "hour"])
    op.execute(MEASURED_AGAIN)
    where: sa.ColumnElement[bool] = sa.literal_column("again")
    op.create_index("runs_again", "runs", list(AGAIN), sqlite_where=where, postgresql_where=where)
    _make_hours(text)
    tell_sizes(connection)  # the hours are counted when their tables are those of today: see v0010


def _order_texts(connection: sa.Connection) -> None:
    look = sa.inspect(connection)
    for table in look.get_table_names():
        if table == "alembic_version":
            continue
        changes = [
            f'ALTER COLUMN "{column["name"]}" TYPE TEXT COLLATE "C"'
            for column in look.get_columns(table)
            if isinstance(column["type"], sa.Text)
        ]
        op.execute(f"ALTER TABLE {table} {', '.join(changes)}")


def _divide(connection: sa.Connection, table: str, key: tuple[str, ...], months: list[str]) -> None:
    op.execute(f"ALTER TABLE {table} RENAME TO {table}_whole")
    op.execute(f"CREATE TABLE {table} (LIKE {table}_whole INCLUDING DEFAULTS) PARTITION BY RANGE (run)")
    make_rest(connection, table)
    make_months(connection, months, table)
    op.execute(f"INSERT INTO {table} SELECT * FROM {table}_whole")  # noqa: S608 - its own
    op.execute(f"DROP TABLE {table}_whole")
    op.execute(f"ALTER TABLE {table} ADD CONSTRAINT {table}_pkey PRIMARY KEY (chain, {', '.join(key)})")


def _make_hours(text: sa.Text) -> None:
    def keys(*names: str) -> list[sa.Column[str]]:
        return [sa.Column(name, text, primary_key=True) for name in names]

    def flags(*names: str) -> list[sa.Column[bool]]:
        return [sa.Column(name, sa.Boolean(), primary_key=True) for name in names]

    op.create_table(
        "run_hours",
        *keys("chain", "hour", "bench", "recipe"),
        sa.Column("revision", sa.Integer(), primary_key=True, autoincrement=False),
        *keys("model", "operator", "key", "state", "verdict", "master"),
        *flags("virtual", "in_production", "valid", "first"),
        sa.Column("runs", sa.Integer(), nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "metric_hours",
        *keys("chain", "metric", "hour", "bench", "recipe"),
        sa.Column("revision", sa.Integer(), primary_key=True, autoincrement=False),
        *keys("model", "operator", "key"),
        *flags("virtual"),
        *keys("choices", "branch", "definition", "estimator", "band", "torque_nm", "unit", "side"),
        sa.Column("number", sa.Integer(), nullable=False),
        *(sa.Column(name, sa.Double(), nullable=False) for name in ("mean", "squares")),
        sa.Column("failed", sa.Integer(), nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_index("metric_hours_hour", "metric_hours", ["chain", "hour"])
    op.create_table(
        "cause_hours",
        *keys("chain", "kind", "hour", "bench", "recipe"),
        sa.Column("revision", sa.Integer(), primary_key=True, autoincrement=False),
        *keys("model", "operator", "key"),
        *flags("virtual"),
        *keys("name"),
        sa.Column("runs", sa.Integer(), nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_index("cause_hours_hour", "cause_hours", ["chain", "hour"])
