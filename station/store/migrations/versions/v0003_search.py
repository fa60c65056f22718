"""The model of a run, an index of what runs are looked for by, and what was seen of a chain's file."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

MODELS = """
UPDATE runs SET model = COALESCE((
    SELECT MIN(units.model) FROM units WHERE units.chain = runs.chain AND units.serial = runs.serial
), '')
"""


def upgrade() -> None:
    """Bring the tables to this version; a run from before it is of the model that its serial number is known with."""
    op.add_column("projections", sa.Column("seen", sa.Text(), nullable=False, server_default=""))
    op.add_column("runs", sa.Column("model", sa.Text(), nullable=False, server_default=""))
    op.execute(MODELS)
    op.create_index("runs_model", "runs", ["chain", "model"])
    columns = ["chain", "run", "serial", "model", "recipe", "verdict", "operator", "started", "master"]
    op.create_index("runs_search", "runs", columns)
