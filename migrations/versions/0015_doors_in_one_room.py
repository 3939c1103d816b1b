"""A door whose two sides are one room is a connector, too.

A new database has no such check from its first revision on. Going down deletes these doors, which
former revisions cannot hold.
"""

from __future__ import annotations

from alembic import op

revision = "0015"
down_revision = "0014"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Drop the check that both places differ."""
    op.execute("ALTER TABLE semmap.connector DROP CONSTRAINT IF EXISTS connector_check")


def downgrade() -> None:
    """Delete doors inside one room, and restore the check."""
    op.execute(
        "DELETE FROM semmap.entity e USING semmap.connector c "
        "WHERE c.entity_id = e.id AND c.place_a = c.place_b"
    )
    op.execute(
        "ALTER TABLE semmap.connector ADD CONSTRAINT connector_check CHECK (place_a <> place_b)"
    )
