"""Functions read the schema's own tables, whatever a session's search path and temporary tables."""

from __future__ import annotations

revision = "0036"
down_revision = "0035"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """The functions alone are other ones; they are installed after each upgrade."""


def downgrade() -> None:
    """The tables are the same."""
