"""Of two objects of one size at one place, neither is in the other."""

from __future__ import annotations

revision = "0035"
down_revision = "0034"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """The functions alone are other ones; they are installed after each upgrade."""


def downgrade() -> None:
    """The tables are the same."""
