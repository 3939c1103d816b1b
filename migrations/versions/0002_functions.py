"""Functions alone: rooms of what is as near to two, short walls, the speed of moves."""

from __future__ import annotations

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Change no table; the functions are made after the last revision."""


def downgrade() -> None:
    """Change no table."""
