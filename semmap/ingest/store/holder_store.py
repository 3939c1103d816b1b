"""The inventories of a map, derived from its geometry (Deeken et al., section 3.4, "Objects").

The rules are those of the function `derived_holders` in the schema, which each move applies, too.
"""

from __future__ import annotations

from typing import Any

import psycopg
import shapely

from semmap.geometry.surfaces import support_surfaces
from semmap.geometry.tin import to_mesh
from semmap.limits import SURFACE_TRIANGLES
from semmap.query.meshes import model_triangles

__all__ = ["derive_inventories", "find_surfaces", "postpone_derivation"]


def postpone_derivation(connection: psycopg.Connection[Any]) -> None:
    """Derive no holders at the statements of this transaction; `derive_inventories` does it."""
    connection.execute("SELECT set_config('semmap.deriving', 'off', true)")


def derive_inventories(connection: psycopg.Connection[Any], map_id: int) -> int:
    """Give each object of the map the holder that the geometry shows; return how many changed.

    A stated holder stays unless the geometry contradicts it. Within the caller's transaction.
    """
    find_surfaces(connection, map_id)
    row = connection.execute(
        "SELECT derive_again(ARRAY(SELECT id FROM entity WHERE map_id = %s AND kind = 'object'))",
        (map_id,),
    ).fetchone()
    assert row is not None
    return int(row[0])


def find_surfaces(connection: psycopg.Connection[Any], map_id: int) -> None:
    """Store the support surfaces of the map's models, each searched once, and what they hold."""
    with connection.cursor() as cursor:
        cursor.execute(
            "SELECT DISTINCT m.id FROM model m JOIN entity_model em ON em.model_id = m.id "
            "JOIN entity e ON e.id = em.entity_id "
            "WHERE e.map_id = %s AND e.kind = 'object' AND m.kind IN ('mesh', 'box', 'polygon') "
            "AND m.triangles BETWEEN 1 AND %s AND NOT EXISTS "
            "(SELECT FROM support_surface s WHERE s.model_id = m.id) ORDER BY m.id",
            (map_id, SURFACE_TRIANGLES.value),
        )
        models = [row[0] for row in cursor.fetchall()]
        for model_id in models:
            found = support_surfaces(to_mesh(model_triangles(connection, model_id)))
            for number, surface in enumerate(found):
                cursor.execute(
                    "INSERT INTO support_surface (model_id, number, height, outline, faces) "
                    "VALUES (%s, %s, %s, ST_GeomFromWKB(%s, 0), %s)",
                    (
                        model_id,
                        number,
                        surface.height,
                        shapely.to_wkb(surface.outline),
                        [int(f) for f in surface.faces],
                    ),
                )
            if not found:
                cursor.execute(
                    "INSERT INTO support_surface (model_id, number) VALUES (%s, 0)", (model_id,)
                )
        cursor.execute(
            "SELECT follow_change(ARRAY(SELECT entity_id FROM entity_model "
            "WHERE model_id = ANY(%s)))",
            (models,),
        )
