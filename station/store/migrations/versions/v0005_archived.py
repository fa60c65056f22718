"""Where archived runs are."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Bring the tables to this version."""
    op.create_table(
        "archived",
        sa.Column("chain", sa.Text(), primary_key=True),
        sa.Column("run", sa.Text(), primary_key=True),
        *(sa.Column(name, sa.Text(), nullable=False) for name in ("sha256", "url", "object", "object_sha256")),
        sa.Column("row_group", sa.Integer(), nullable=False),
        sa.Column("trace_object", sa.Text()),
        sa.Column("trace_row_group", sa.Integer()),
        sa.Column("trace_sha256", sa.Text()),
        sa.Column("verified", sa.Text(), nullable=False),
        sqlite_with_rowid=False,
    )
