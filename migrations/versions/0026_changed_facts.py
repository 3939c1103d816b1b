"""The change log has the statements that changed, and changes of links.

Former changes have none: a reader of the log takes them as changes of any statement.
"""

from __future__ import annotations

from alembic import op

revision = "0026"
down_revision = "0025"
branch_labels = None
depends_on = None

KINDS = "'added', 'changed', 'moved', 'removed', 'reshaped', 'field', 'belief', 'statement'"


def upgrade() -> None:
    """Add the column and the kind."""
    op.execute("ALTER TABLE semmap.change ADD COLUMN IF NOT EXISTS facts jsonb")
    _allow(f"{KINDS}, 'linked'")


def downgrade() -> None:
    """Remove them, with the changes of links."""
    op.execute("DELETE FROM semmap.change WHERE what = 'linked'")
    _allow(KINDS)
    op.execute("ALTER TABLE semmap.change DROP COLUMN facts")


def _allow(kinds: str) -> None:
    op.execute("ALTER TABLE semmap.change DROP CONSTRAINT IF EXISTS change_what_check")
    op.execute(
        f"ALTER TABLE semmap.change ADD CONSTRAINT change_what_check CHECK (what IN ({kinds}))"
    )
