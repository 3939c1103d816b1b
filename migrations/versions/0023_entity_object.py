"""The object model of each entity.

A new database has the table from its first revision on. Going down keeps it.
"""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import make_tables

revision = "0023"
down_revision = "0022"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the table where it is missing, with what the meshes say."""
    make_tables(op, "140_entity_object.sql", "entity_object")
    op.execute(
        "INSERT INTO entity_object (entity_id, object_id) "
        "SELECT DISTINCT ON (em.entity_id) em.entity_id, h.object_id FROM entity_model em "
        "JOIN model m ON m.id = em.model_id JOIN object_mesh h ON h.digest = m.digest "
        "ORDER BY em.entity_id, em.role DESC, h.object_id ON CONFLICT DO NOTHING"
    )


def downgrade() -> None:
    """Leave it as it is."""
