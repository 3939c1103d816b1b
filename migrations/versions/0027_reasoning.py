"""Inferences of a map, and shapes that bind its updates.

A new database has their tables from its first revision on. Going down keeps them.
"""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import make_tables

revision = "0027"
down_revision = "0026"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the tables where they are missing."""
    make_tables(op, "140_reasoning.sql", "reasoning")


def downgrade() -> None:
    """Leave them as they are."""
