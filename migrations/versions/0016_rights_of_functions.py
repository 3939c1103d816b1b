"""Functions that can write are executed by those who need them alone."""

from __future__ import annotations

revision = "0016"
down_revision = "0015"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Nothing: each upgrade makes the code again."""


def downgrade() -> None:
    """Leave the rights as they are."""
