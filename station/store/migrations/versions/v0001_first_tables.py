"""First tables."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Bring the tables to this version."""
    op.create_table(
        "alarms",
        sa.Column("chain", sa.Text(), nullable=False),
        sa.Column("run", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("id", sa.Text(), nullable=True),
        sa.Column("scan", sa.Integer(), nullable=True),
        sa.Column("t_s", sa.Double(), nullable=True),
        sa.Column("state", sa.Text(), nullable=True),
        sa.Column("reaction", sa.Text(), nullable=True),
        sa.Column("first", sa.Boolean(), nullable=True),
        sa.Column("text", sa.Text(), nullable=True),
        sa.PrimaryKeyConstraint("chain", "run", "position"),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "attempts",
        sa.Column("chain", sa.Text(), nullable=False),
        sa.Column("run", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("counter", sa.Integer(), nullable=True),
        sa.Column("serial", sa.Text(), nullable=False),
        sa.Column("attempt", sa.Integer(), nullable=False),
        sa.Column("recipe_sha256", sa.Text(), nullable=False),
        sa.Column("bench_sha256", sa.Text(), nullable=False),
        sa.Column("created", sa.Text(), nullable=True),
        sa.Column("key", sa.Text(), nullable=True),
        sa.PrimaryKeyConstraint("chain", "run"),
        sqlite_with_rowid=False,
    )
    op.create_index("attempts_recipe", "attempts", ["chain", "recipe_sha256"], unique=False)
    op.create_index("attempts_serial", "attempts", ["chain", "serial", "attempt"], unique=False)
    op.create_table(
        "benches",
        sa.Column("chain", sa.Text(), nullable=False),
        sa.Column("sha256", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("revision", sa.Integer(), nullable=True),
        sa.Column("embedded", sa.Boolean(), nullable=True),
        sa.Column("public_key", sa.Text(), nullable=True),
        sa.PrimaryKeyConstraint("chain", "sha256"),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "calibrations",
        sa.Column("chain", sa.Text(), nullable=False),
        sa.Column("run", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("quadrant", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("id", sa.Text(), nullable=True),
        sa.Column("model", sa.Text(), nullable=True),
        sa.Column("made", sa.Text(), nullable=True),
        sa.Column("slope", sa.Double(), nullable=True),
        sa.Column("offset_nm", sa.Double(), nullable=True),
        sa.Column("u_slope", sa.Double(), nullable=True),
        sa.Column("u_offset_nm", sa.Double(), nullable=True),
        sa.Column("residual_sd_nm", sa.Double(), nullable=True),
        sa.Column("points", sa.Integer(), nullable=True),
        sa.PrimaryKeyConstraint("chain", "run", "quadrant"),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "checks",
        sa.Column("chain", sa.Text(), nullable=False),
        sa.Column("run", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("id", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("figure", sa.Double(), nullable=True),
        sa.Column("limit", sa.Double(), nullable=True),
        sa.Column("unit", sa.Text(), nullable=True),
        sa.Column("passed", sa.Boolean(), nullable=True),
        sa.Column("text", sa.Text(), nullable=True),
        sa.PrimaryKeyConstraint("chain", "run", "id"),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "metrics",
        sa.Column("chain", sa.Text(), nullable=False),
        sa.Column("run", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("side", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("main", sa.Boolean(), nullable=False),
        sa.Column("metric", sa.Text(), nullable=False),
        sa.Column("definition", sa.Text(), nullable=True),
        sa.Column("unit", sa.Text(), nullable=True),
        sa.Column("branch", sa.Text(), nullable=True),
        sa.Column("estimator", sa.Text(), nullable=True),
        sa.Column("band", sa.Text(), nullable=True),
        sa.Column("torque_nm", sa.Text(), nullable=True),
        sa.Column("choices", sa.Text(), nullable=False),
        sa.Column("cycles", sa.Integer(), nullable=True),
        sa.Column("value", sa.Double(), nullable=True),
        sa.Column("uncertainty", sa.Double(), nullable=True),
        sa.Column("coverage_factor", sa.Double(), nullable=True),
        sa.Column("limit_min", sa.Double(), nullable=True),
        sa.Column("limit_max", sa.Double(), nullable=True),
        sa.Column("verdict", sa.Text(), nullable=True),
        sa.PrimaryKeyConstraint("chain", "run", "position", "side"),
        sqlite_with_rowid=False,
    )
    op.create_index("metrics_metric", "metrics", ["chain", "metric", "run"], unique=False)
    op.create_table(
        "projections",
        sa.Column("chain", sa.Text(), nullable=False),
        sa.Column("offset", sa.BigInteger(), nullable=False),
        sa.Column("counter", sa.Integer(), nullable=False),
        sa.Column("sha256", sa.Text(), nullable=False),
        sa.Column("prefix_sha256", sa.Text(), nullable=False),
        sa.Column("problems", sa.JSON(), nullable=False),
        sa.Column("keys", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("chain"),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "recipes",
        sa.Column("chain", sa.Text(), nullable=False),
        sa.Column("sha256", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("revision", sa.Integer(), nullable=True),
        sa.PrimaryKeyConstraint("chain", "sha256"),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "runs",
        sa.Column("chain", sa.Text(), nullable=False),
        sa.Column("run", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("counter", sa.Integer(), nullable=True),
        sa.Column("entry_sha256", sa.Text(), nullable=True),
        sa.Column("key", sa.Text(), nullable=True),
        sa.Column("sha256", sa.Text(), nullable=True),
        sa.Column("state", sa.Text(), nullable=False),
        sa.Column("verdict", sa.Text(), nullable=True),
        sa.Column("serial", sa.Text(), nullable=False),
        sa.Column("attempt", sa.Integer(), nullable=False),
        sa.Column("recipe", sa.Text(), nullable=False),
        sa.Column("revision", sa.Integer(), nullable=True),
        sa.Column("bench", sa.Text(), nullable=False),
        sa.Column("started", sa.Text(), nullable=True),
        sa.Column("ended", sa.Text(), nullable=True),
        sa.Column("operator", sa.Text(), nullable=True),
        sa.Column("scenario", sa.Text(), nullable=True),
        sa.Column("clock", sa.Text(), nullable=True),
        sa.Column("virtual", sa.Boolean(), nullable=False),
        sa.Column("torque_source", sa.Text(), nullable=False),
        sa.Column("objection", sa.Text(), nullable=False),
        sa.Column("records", sa.Integer(), nullable=True),
        sa.Column("altered", sa.Text(), nullable=False),
        sa.Column("seen", sa.Text(), nullable=False),
        sa.Column("seen_files", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("chain", "run"),
        sqlite_with_rowid=False,
    )
    op.create_index("runs_recipe", "runs", ["chain", "recipe"], unique=False)
    op.create_index("runs_serial", "runs", ["chain", "serial"], unique=False)
    op.create_table(
        "units",
        sa.Column("chain", sa.Text(), nullable=False),
        sa.Column("serial", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("model", sa.Text(), autoincrement=False, nullable=False),
        sa.Column("virtual", sa.Text(), autoincrement=False, nullable=False),
        sa.PrimaryKeyConstraint("chain", "serial", "model", "virtual"),
        sqlite_with_rowid=False,
    )


def downgrade() -> None:
    """Bring them back to the version before."""
    op.drop_table("units")
    op.drop_index("runs_serial", table_name="runs")
    op.drop_index("runs_recipe", table_name="runs")
    op.drop_table("runs")
    op.drop_table("recipes")
    op.drop_table("projections")
    op.drop_index("metrics_metric", table_name="metrics")
    op.drop_table("metrics")
    op.drop_table("checks")
    op.drop_table("calibrations")
    op.drop_table("benches")
    op.drop_index("attempts_serial", table_name="attempts")
    op.drop_index("attempts_recipe", table_name="attempts")
    op.drop_table("attempts")
    op.drop_table("alarms")
