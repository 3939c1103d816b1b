"""A contributor for outcomes of simulated robots that nobody tried."""

from __future__ import annotations

from alembic import op

revision = "0032"
down_revision = "0031"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add it, without trust: its outcomes count for nothing."""
    op.execute(
        "UPDATE semmap.contributor SET name = name || ' (' || id || ')' "
        "WHERE name = 'assumed' AND id <> 3"
    )
    op.execute(
        "INSERT INTO semmap.contributor (id, name, trust) VALUES (3, 'assumed', 0) "
        "ON CONFLICT DO NOTHING"
    )


def downgrade() -> None:
    """Delete it with its outcomes."""
    op.execute("DELETE FROM semmap.task WHERE contributor_id = 3")
    op.execute("DELETE FROM semmap.contributor WHERE id = 3")
