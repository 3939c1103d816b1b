"""An index on statements whose object is not an entity."""

from __future__ import annotations

from alembic import op

revision = "0029"
down_revision = "0028"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make it: a join with entities asks for such objects, of which most properties have none."""
    op.execute(
        "CREATE INDEX IF NOT EXISTS statement_object ON semmap.statement (map_id, predicate) "
        "WHERE object IS NOT NULL"
    )


def downgrade() -> None:
    """Drop it."""
    op.execute("DROP INDEX IF EXISTS semmap.statement_object")
