"""The posture with which a robot drives, and carries what it took."""

from __future__ import annotations

from alembic import op

revision = "0034"
down_revision = "0033"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add it; that of stored robots is at rest."""
    op.execute(
        "ALTER TABLE semmap.automaton ADD COLUMN IF NOT EXISTS posture jsonb NOT NULL DEFAULT '{}' "
        "CHECK (jsonb_typeof(posture) = 'object')"
    )


def downgrade() -> None:
    """The postures stay."""
