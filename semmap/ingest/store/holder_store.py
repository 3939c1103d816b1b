"""The inventories of a map, by `derived_holders` of the schema (Deeken et al., section 3.4)."""

from __future__ import annotations

from typing import Any

import psycopg
import shapely
from psycopg.rows import dict_row

from semmap.geometry.surfaces import support_surfaces
from semmap.geometry.tin import to_mesh
from semmap.ingest.store.copy_rows import copy_rows
from semmap.limits import SURFACE_TRIANGLES
from semmap.query.meshes import model_triangles


def postpone_derivation(connection: psycopg.Connection[Any]) -> None:
    """Derive no holders at the statements of this transaction; `derive_inventories` does it."""
    connection.execute("SELECT set_config('semmap.deriving', 'off', true)")


def recognise_parts(connection: psycopg.Connection[Any], map_id: int) -> list[dict[str, Any]]:
    """Find floors, walls and ceilings among objects by their shape; return all such of the map."""
    connection.execute(
        "SELECT recognise_parts(ARRAY("
        "SELECT id FROM entity WHERE map_id = %s AND kind = 'object'))",
        (map_id,),
    )
    with connection.cursor(row_factory=dict_row) as cursor:
        return cursor.execute(
            "SELECT name, type, (guess ->> 'confidence')::float8 AS confidence FROM entity "
            "CROSS JOIN LATERAL (SELECT properties -> 'type_guess') g (guess) WHERE map_id = %s "
            "AND kind = 'object' AND guess ->> 'from' = 'shape' AND type = guess ->> 'type'",
            (map_id,),
        ).fetchall()


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


def find_surfaces(
    connection: psycopg.Connection[Any], map_id: int, entity: int | None = None
) -> None:
    """Store the support surfaces of models of a map, or of an entity; each is searched once."""
    with connection.cursor() as cursor:
        cursor.execute(
            "SELECT DISTINCT m.id FROM model m JOIN entity_model em ON em.model_id = m.id "
            "JOIN entity e ON e.id = em.entity_id "
            "WHERE e.map_id = %s AND e.id = coalesce(%s, e.id) AND e.kind = 'object' "
            "AND m.kind IN ('mesh', 'box', 'polygon') AND m.triangles BETWEEN 1 AND %s "
            "AND NOT EXISTS (SELECT FROM support_surface s WHERE s.model_id = m.id) ORDER BY m.id",
            (map_id, entity, SURFACE_TRIANGLES.value),
        )
        rows: list[tuple[Any, ...]] = []
        for (model,) in cursor.fetchall():
            found = support_surfaces(to_mesh(model_triangles(connection, model)))
            rows += [
                (model, number, s.height, shapely.to_wkb(s.outline, hex=True), s.faces.tolist())
                for number, s in enumerate(found)
            ] or [(model, 0, None, None, None)]
        if rows:
            columns = ("model_id", "number", "height", "outline", "faces")
            copy_rows(cursor, "support_surface", columns, rows)
