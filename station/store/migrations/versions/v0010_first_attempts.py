"""Which run is the first attempt at its unit: one that was simulated, or had faults injected, is none at a real one."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from station.store.plant.hours import count_all_hours
from station.store.plant.retests import note_attempts

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None

QUALITY = (
    "chain", "in_production", "virtual", "run", "attempt", "key", "state", "verdict", "valid", "serial", "recipe",
    "revision", "model", "bench", "operator", "started", "hour", "fixture", "lock_angle_deg", "first",
)  # fmt: skip
AGAIN = (
    "chain", "in_production", "virtual", "serial", "run", "attempt", "key", "state", "verdict", "recipe", "revision",
    "model", "bench", "operator", "started", "hour", "fixture", "lock_angle_deg", "first",
)  # fmt: skip


def upgrade() -> None:
    """Bring the tables to this version."""
    connection = op.get_bind()
    op.add_column("runs", sa.Column("first", sa.Boolean(), nullable=False, server_default=sa.false()))
    op.execute("UPDATE runs SET first = TRUE WHERE attempt = 1")
    measured_again = sa.text("SELECT DISTINCT chain, serial FROM runs WHERE attempt > 1")
    for chain, serial in connection.execute(measured_again).tuples().all():
        note_attempts(connection, chain, [serial])
    where: sa.ColumnElement[bool] = sa.literal_column("again")
    op.drop_index("runs_quality", "runs")
    op.create_index("runs_quality", "runs", list(QUALITY))
    op.drop_index("runs_again", "runs")
    op.create_index("runs_again", "runs", list(AGAIN), sqlite_where=where, postgresql_where=where)
    count_all_hours(connection)
