"""Changes of fields in the change log, and typical sizes of semantic types.

A new database has both from its first revision on. Going down keeps them.
"""

from __future__ import annotations

from alembic import op

revision = "0017"
down_revision = "0016"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Allow the new kind of change, add the column where it is missing."""
    for statement in (
        "ALTER TABLE semmap.change DROP CONSTRAINT IF EXISTS change_what_check",
        "ALTER TABLE semmap.change ADD CONSTRAINT change_what_check CHECK (what IN "
        "('added', 'changed', 'moved', 'removed', 'reshaped', 'field'))",
        "ALTER TABLE semmap.semantic_type ADD COLUMN IF NOT EXISTS "
        "typical_size double precision[] CHECK (cardinality(typical_size) = 3 "
        "AND 0 < ALL (typical_size) AND 'Infinity' > ALL (typical_size))",
    ):
        op.execute(statement)


def downgrade() -> None:
    """Leave both as they are."""
