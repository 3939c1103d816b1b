"""How far trial and error moved an action, and an index on the actions that were tried."""

from __future__ import annotations

from alembic import op

revision = "0033"
down_revision = "0032"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add them; of corrections that are stored already, the shift stays unknown."""
    op.execute(
        "ALTER TABLE semmap.action ADD COLUMN IF NOT EXISTS shift double precision[], "
        "DROP CONSTRAINT IF EXISTS action_shift_has_three_finite_numbers, "
        "ADD CONSTRAINT action_shift_has_three_finite_numbers CHECK (cardinality(shift) = 3 "
        "AND array_position(shift, NULL) IS NULL AND 'NaN' <> ALL (shift) "
        "AND 'Infinity' > ALL (shift) AND '-Infinity' < ALL (shift))"
    )
    op.execute(
        "CREATE INDEX IF NOT EXISTS action_tried ON semmap.action (object_id, kind) "
        "WHERE attempts > 0"
    )


def downgrade() -> None:
    """Drop the index; the shifts stay."""
    op.execute("DROP INDEX IF EXISTS semmap.action_tried")
