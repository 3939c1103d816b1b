"""Give the meshes of earlier versions the outline of the ground that they cover."""

from __future__ import annotations

import shapely
from alembic import op

from semmap.database.maps import driver_of
from semmap.geometry.ground_outline import ground_outline
from semmap.geometry.mesh import Mesh
from semmap.geometry.outline import hull_points
from semmap.query.meshes import model_triangles

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

MESHES = """
SELECT id FROM semmap.model m WHERE triangles > 0 AND outline IS NULL AND NOT EXISTS (
    SELECT FROM semmap.entity_model em JOIN semmap.entity e ON e.id = em.entity_id
    WHERE em.model_id = m.id AND e.kind IN ('room', 'region'))
"""

STALE = """
UPDATE semmap.world SET footprint = NULL
WHERE entity_id IN (SELECT entity_id FROM semmap.entity_model WHERE model_id = %s)
"""


def upgrade() -> None:
    """Set outlines; functions/610_earlier_maps.sql computes footprints that are null again."""
    connection = driver_of(op.get_bind())
    for (model,) in connection.execute(MESHES).fetchall():
        mesh = Mesh.of_triangles(model_triangles(connection, model))
        outline = ground_outline(mesh, hull_points(mesh))
        if outline is not None:
            connection.execute(
                "UPDATE semmap.model SET outline = ST_GeomFromWKB(%s, 0) WHERE id = %s",
                (shapely.to_wkb(outline), model),
            )
            connection.execute(STALE, (model,))


def downgrade() -> None:
    """Keep the outlines: former functions use them, too."""
