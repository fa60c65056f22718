"""Runs whose records a rule has removed; their lines are found by a walk through each chain, which begins anew."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Bring the tables to this version."""
    text = sa.Text().with_variant(sa.Text(collation="C"), "postgresql")
    op.create_table(
        "removals",
        *(sa.Column(name, text, primary_key=True) for name in ("chain", "run")),
        *(sa.Column(name, text, nullable=False) for name in ("rule", "key")),
        sqlite_with_rowid=False,
    )
    op.execute("UPDATE projections SET prefix_sha256 = '', seen = ''")
