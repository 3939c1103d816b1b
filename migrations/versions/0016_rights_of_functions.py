"""Functions that can write are executed by those who need them alone."""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import drop_code, run_code

revision = "0016"
down_revision = "0015"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Replace the code."""
    drop_code(op)
    run_code(op)


def downgrade() -> None:
    """Leave the rights as they are."""
