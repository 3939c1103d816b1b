"""Inventories that follow the geometry: why a holder ended, and the code that derives holders.

A new database has the column from its first revision on. Going down keeps it.
"""

from __future__ import annotations

from alembic import op

revision = "0011"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the column where it is missing."""
    op.execute("ALTER TABLE semmap.placement_history ADD COLUMN IF NOT EXISTS reason text")


def downgrade() -> None:
    """Leave the column where it is."""
