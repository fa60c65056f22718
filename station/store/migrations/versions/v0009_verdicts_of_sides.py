"""Each side of a metric has its own verdict: the side that a metric goes by had that of the metric, the worst of all.

Which side made it the worst is not told by the rows where both say the same and did not pass. These runs are few; they
are put in again from their records. A run whose record a rule has removed keeps its rows.
"""

from __future__ import annotations

from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

NOT_TOLD = """
EXISTS (
    SELECT 1 FROM metrics one JOIN metrics other ON other.chain = one.chain AND other.run = one.run
    AND other.position = one.position AND other.side <> one.side AND other.verdict = one.verdict
    WHERE one.chain = runs.chain AND one.run = runs.run AND one.main AND one.verdict <> 'PASS'
) AND NOT EXISTS (SELECT 1 FROM removals WHERE removals.chain = runs.chain AND removals.run = runs.run)
"""


def upgrade() -> None:
    """Bring the tables to this version."""
    # Without the line that concluded it a run is put in anew when its chain is walked from the start, and one from
    # before the chain when its run.json is not the one that was seen.
    op.execute(f"UPDATE runs SET entry_sha256 = NULL, seen = '' WHERE {NOT_TOLD}")  # noqa: S608 - a constant
    op.execute(
        "UPDATE projections SET prefix_sha256 = '', seen = '' WHERE EXISTS "
        "(SELECT 1 FROM runs WHERE runs.chain = projections.chain AND runs.seen = '' AND runs.entry_sha256 IS NULL)"
    )
