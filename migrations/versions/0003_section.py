"""Keep the section of walls, which a floor plan shows; functions/600_section.sql maintains it."""

from __future__ import annotations

from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the table; its rows follow from the geometry when the functions are made."""
    op.execute(
        """
        CREATE TABLE semmap.section (
            entity_id bigint PRIMARY KEY REFERENCES semmap.world ON DELETE CASCADE,
            -- in the entity's frame as it lies, turned about z and shifted on the ground alone
            outline   geometry(MultiPolygon, 0) NOT NULL
        )
        """
    )


def downgrade() -> None:
    """Drop the table: its rows are derived."""
    op.execute("DROP TABLE semmap.section")
