"""What the statistics of a production ask of every run, and an index that holds all of it."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

COLUMNS = [
    "chain", "in_production", "virtual", "run", "attempt", "key", "state", "verdict", "valid", "serial", "recipe",
    "revision", "model", "bench", "operator", "started",
]  # fmt: skip


def upgrade() -> None:
    """Bring the tables to this version."""
    for name in ("in_production", "valid"):
        op.add_column("runs", sa.Column(name, sa.Boolean(), nullable=False, server_default=sa.false()))
    runs = sa.table(
        "runs",
        *(
            sa.column(name)
            for name in ("master", "scenario", "altered", "state", "objection", "in_production", "valid")
        ),
    )
    production = (runs.c.master == "") & runs.c.scenario.is_(None) & (runs.c.altered == "")
    op.execute(sa.update(runs).where(production).values(in_production=sa.true()))
    valid = (runs.c.state == "complete") & (runs.c.objection == "") & (runs.c.altered == "")
    op.execute(sa.update(runs).where(valid).values(valid=sa.true()))
    op.create_index("runs_quality", "runs", COLUMNS)
