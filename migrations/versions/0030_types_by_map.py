"""The index of entities by type is led by the map."""

from __future__ import annotations

from alembic import op

revision = "0030"
down_revision = "0029"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make it again: a query of one map read the entities of a type in all maps."""
    _lead("map_id, type, id", "label")


def downgrade() -> None:
    """Let the type lead it."""
    _lead("type, id", "map_id, label")


def _lead(key: str, others: str) -> None:
    op.execute(
        "ALTER TABLE semmap.object_type DROP CONSTRAINT IF EXISTS object_type_pkey, "
        f"ADD CONSTRAINT object_type_pkey PRIMARY KEY ({key}) INCLUDE ({others})"
    )
