"""Which runs are of a master part."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Bring the tables to this version; no run from before it says that its unit is a master part."""
    op.add_column("runs", sa.Column("master", sa.Text(), nullable=False, server_default=""))
