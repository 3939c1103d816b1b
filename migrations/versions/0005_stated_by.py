"""Keep who made a statement, so that a robot takes back its own alone."""

from __future__ import annotations

from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the column; nobody is known to have made the statements of before."""
    op.execute("ALTER TABLE semmap.statement ADD COLUMN stated_by name")  # a role
    op.execute("ALTER TABLE semmap.statement ALTER COLUMN stated_by SET DEFAULT current_user")


def downgrade() -> None:
    """Drop the column: version 0.1.0 let each robot take back all statements."""
    op.execute("ALTER TABLE semmap.statement DROP COLUMN stated_by")
