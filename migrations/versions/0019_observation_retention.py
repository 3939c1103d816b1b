"""How long observations of agents are kept."""

from __future__ import annotations

from alembic import op

revision = "0019"
down_revision = "0018"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """State the retention where there is none."""
    op.execute(
        "INSERT INTO semmap.retention (kind, keep_every, keep_for) "
        "VALUES ('observation', NULL, '30 days') ON CONFLICT DO NOTHING"
    )


def downgrade() -> None:
    """Leave it as it is."""
