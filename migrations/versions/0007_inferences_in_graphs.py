"""Keep what follows from the statements of each named graph."""

from __future__ import annotations

from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the graph of an inference, and of which axioms those of named graphs are."""
    op.execute(
        "ALTER TABLE semmap.inference "
        "ADD COLUMN graph text NOT NULL DEFAULT 'urn:semmap:inferred'"  # that of the map, or an IRI
    )
    op.execute(
        "ALTER TABLE semmap.reasoning "
        "ADD COLUMN graphs jsonb NOT NULL DEFAULT '{}'"  # digests of ontologies by named graph
    )
    op.execute(
        "CREATE INDEX inference_graph ON semmap.inference (map_id, graph) "
        "WHERE graph <> 'urn:semmap:inferred'"
    )


def downgrade() -> None:
    """Leave the inferences of the map alone."""
    op.execute("DELETE FROM semmap.inference WHERE graph <> 'urn:semmap:inferred'")
    op.execute("ALTER TABLE semmap.inference DROP COLUMN graph")
    op.execute("ALTER TABLE semmap.reasoning DROP COLUMN graphs")
