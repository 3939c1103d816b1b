"""The change log has the inferences that were stored or removed."""

from __future__ import annotations

from alembic import op

revision = "0031"
down_revision = "0030"
branch_labels = None
depends_on = None

KINDS = (
    "'added', 'changed', 'moved', 'removed', 'reshaped', 'field', 'belief', 'statement', 'linked'"
)


def upgrade() -> None:
    """Add the kind."""
    _allow(f"{KINDS}, 'inferred'")


def downgrade() -> None:
    """Remove it, with its changes."""
    op.execute("DELETE FROM semmap.change WHERE what = 'inferred'")
    _allow(KINDS)


def _allow(kinds: str) -> None:
    op.execute("ALTER TABLE semmap.change DROP CONSTRAINT IF EXISTS change_what_check")
    op.execute(
        f"ALTER TABLE semmap.change ADD CONSTRAINT change_what_check CHECK (what IN ({kinds}))"
    )
