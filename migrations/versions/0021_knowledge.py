"""Statements that no other table has a column for, in named graphs.

A new database has their table from its first revision on. Going down keeps it.
"""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import make_tables

revision = "0021"
down_revision = "0020"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the table where it is missing."""
    for statement in (
        "ALTER TABLE semmap.change DROP CONSTRAINT IF EXISTS change_what_check",
        "ALTER TABLE semmap.change ADD CONSTRAINT change_what_check CHECK (what IN "
        "('added', 'changed', 'moved', 'removed', 'reshaped', 'field', 'belief', 'statement'))",
    ):
        op.execute(statement)
    make_tables(op, "120_knowledge.sql", "statement")


def downgrade() -> None:
    """Leave it as it is."""
