"""Manipulation knowledge: grippers, object models, actions, paths and tasks.

A new database has their tables and columns from its first revision on. Going down keeps them.
"""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import make_tables

revision = "0020"
down_revision = "0019"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the tables and columns where they are missing."""
    op.execute(
        "ALTER TABLE semmap.semantic_type "
        "ADD COLUMN IF NOT EXISTS functions text[] NOT NULL DEFAULT '{}'"
    )
    make_tables(op, "110_manipulation.sql", "action")


def downgrade() -> None:
    """Leave them as they are."""
