"""How long observations of agents are kept."""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import drop_code, run_code

revision = "0019"
down_revision = "0018"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """State the retention where there is none, and replace the code."""
    drop_code(op)
    op.execute(
        "INSERT INTO semmap.retention (kind, keep_every, keep_for) "
        "VALUES ('observation', NULL, '30 days') ON CONFLICT DO NOTHING"
    )
    run_code(op)


def downgrade() -> None:
    """Leave it as it is."""
