"""Teaching, observations and beliefs.

A new database has their tables and columns from its first revision on. Going down keeps them.
"""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import make_tables

revision = "0018"
down_revision = "0017"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the tables and columns where they are missing."""
    for statement in (
        "ALTER TABLE semmap.change DROP CONSTRAINT IF EXISTS change_what_check",
        "ALTER TABLE semmap.change ADD CONSTRAINT change_what_check CHECK (what IN "
        "('added', 'changed', 'moved', 'removed', 'reshaped', 'field', 'belief'))",
        "ALTER TABLE semmap.semantic_type "
        "ADD COLUMN IF NOT EXISTS found_in text[] NOT NULL DEFAULT '{}', "
        "ADD COLUMN IF NOT EXISTS properties jsonb NOT NULL DEFAULT '{}' "
        "CHECK (jsonb_typeof(properties) = 'object')",
    ):
        op.execute(statement)
    make_tables(op, "100_belief.sql", "observation")


def downgrade() -> None:
    """Leave them as they are."""
