"""The inventories of a map, derived from its geometry (Deeken et al., section 3.4, "Objects").

What somebody said stays; what has no holder said gets the support surface that it lies on, else
the room that it stands in, with a confidence where it is close.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import psycopg
import shapely
from shapely import Polygon
from shapely.affinity import affine_transform

from semmap.geometry.inventory import RoomSpace, SurfacePatch, Thing, derive_holders
from semmap.geometry.pose import Pose
from semmap.geometry.surfaces import support_surfaces
from semmap.geometry.tin import to_mesh
from semmap.query.meshes import model_triangles

__all__ = ["derive_inventories", "find_surfaces"]

MANY_TRIANGLES = 300_000
"""Models beyond this are not searched for support surfaces: terrains and scans, not furniture."""

SLAB = 0.5
"""Metres by which a part of a storey may reach below its floor."""

BUILDING = ("wall", "floor", "ceiling", "window", "door_leaf", "roof")
"""Types that make up the building: held by their storey, and nothing stands on them."""


def derive_inventories(connection: psycopg.Connection[Any], map_id: int) -> int:
    """Give each object of the map without a said holder the one that geometry shows.

    Within the caller's transaction; returns how many placements changed.
    """
    find_surfaces(connection, map_id)
    things, fixtures = _things(connection, map_id)
    held = derive_holders(things, _surfaces(connection, map_id), _rooms(connection, map_id))
    storeys = _storeys(connection, map_id)
    wanted: dict[int, tuple[int | None, str, float | None]] = {}
    for thing in things:
        holding = held[thing.id]
        if holding.holder is not None:
            wanted[thing.id] = (holding.holder, holding.relation, round(holding.confidence, 3))
        else:
            wanted[thing.id] = (_storey_of(thing, storeys), "in", None)
    for fixture in fixtures:
        wanted[fixture.id] = (_storey_of(fixture, storeys), "in", None)
    _break_circles(connection, map_id, wanted, {f.id: _storey_of(f, storeys) for f in things})
    changed = 0
    with connection.cursor() as cursor:
        cursor.execute(
            "SELECT entity_id, holder_id, relation, confidence FROM placement "
            "WHERE entity_id = ANY(%s)",
            ([*wanted],),
        )
        now = {row[0]: row[1:] for row in cursor}
        for thing_id, holding_now in wanted.items():
            if now[thing_id] != holding_now:
                cursor.execute("SELECT put(%s, %s, %s, %s::float8)", (thing_id, *holding_now))
                changed += 1
    return changed


def _break_circles(
    connection: psycopg.Connection[Any],
    map_id: int,
    wanted: dict[int, tuple[int | None, str, float | None]],
    storeys: dict[int, int | None],
) -> None:
    """What would be held by something that somebody put into it goes to its storey instead."""
    above: dict[int, int | None] = dict(
        connection.execute(
            "SELECT p.entity_id, p.holder_id FROM placement p JOIN entity e ON e.id = p.entity_id "
            "WHERE e.map_id = %s",
            (map_id,),
        ).fetchall()
    )
    above.update({thing: holder for thing, (holder, _, _) in wanted.items()})
    for thing in wanted:
        seen, step = {thing}, above.get(thing)
        while step is not None and step not in seen:
            seen.add(step)
            step = above.get(step)
        if step is not None:
            wanted[thing] = (storeys.get(thing), "in", None)
            above[thing] = storeys.get(thing)


def find_surfaces(connection: psycopg.Connection[Any], map_id: int) -> None:
    """Search the models of the map's objects for support surfaces, each model once ever."""
    with connection.cursor() as cursor:
        cursor.execute(
            "SELECT DISTINCT m.id FROM model m JOIN entity_model em ON em.model_id = m.id "
            "JOIN entity e ON e.id = em.entity_id "
            "WHERE e.map_id = %s AND e.kind = 'object' AND m.kind IN ('mesh', 'box', 'polygon') "
            "AND m.triangles BETWEEN 1 AND %s AND NOT EXISTS "
            "(SELECT FROM support_surface s WHERE s.model_id = m.id) ORDER BY m.id",
            (map_id, MANY_TRIANGLES),
        )
        for (model_id,) in cursor.fetchall():
            found = support_surfaces(to_mesh(model_triangles(connection, model_id)))
            for number, surface in enumerate(found):
                cursor.execute(
                    "INSERT INTO support_surface (model_id, number, height, outline, faces) "
                    "VALUES (%s, %s, %s, ST_GeomFromWKB(%s, 0), %s)",
                    (model_id, number, surface.height, shapely.to_wkb(surface.outline),
                     [int(f) for f in surface.faces]),
                )  # fmt: skip
            if not found:
                cursor.execute(
                    "INSERT INTO support_surface (model_id, number) VALUES (%s, 0)", (model_id,)
                )


def _storeys(connection: psycopg.Connection[Any], map_id: int) -> list[tuple[float, int]]:
    """Height and id of each storey, the lowest first."""
    rows = connection.execute(
        "SELECT w.pose[3], e.id FROM entity e JOIN world w ON w.entity_id = e.id "
        "WHERE e.map_id = %s AND e.kind = 'storey' ORDER BY 1, 2",
        (map_id,),
    ).fetchall()
    return [(height, storey) for height, storey in rows]


def _storey_of(thing: Thing, storeys: list[tuple[float, int]]) -> int | None:
    """The highest storey whose floor is below the thing, slabs and steps allowed for."""
    below = [storey for height, storey in storeys if height <= thing.box[0, 2] + SLAB]
    return below[-1] if below else storeys[0][1] if storeys else None


def _things(connection: psycopg.Connection[Any], map_id: int) -> tuple[list[Thing], list[Thing]]:
    """Objects whose holder nobody said: those to be held, and the parts of the building."""
    rows = connection.execute(
        "SELECT e.id, ST_XMin(w.box), ST_YMin(w.box), ST_ZMin(w.box), ST_XMax(w.box), "
        "ST_YMax(w.box), ST_ZMax(w.box), ST_AsBinary(w.footprint), "
        "coalesce(e.type = ANY (ARRAY(SELECT sub FROM type_closure WHERE super = ANY(%s))), false) "
        "FROM entity e JOIN placement p ON p.entity_id = e.id JOIN world w ON w.entity_id = e.id "
        "LEFT JOIN entity h ON h.id = p.holder_id "
        "WHERE e.map_id = %s AND e.kind = 'object' AND w.footprint IS NOT NULL "
        "AND (p.holder_id IS NULL OR h.kind = 'storey' OR p.confidence IS NOT NULL) ORDER BY e.id",
        (list(BUILDING), map_id),
    ).fetchall()
    things: list[Thing] = []
    fixtures: list[Thing] = []
    for entity_id, *box, footprint, building in rows:
        thing = Thing(entity_id, np.array(box).reshape(2, 3), shapely.from_wkb(bytes(footprint)))
        (fixtures if building else things).append(thing)
    return things, fixtures


def _surfaces(connection: psycopg.Connection[Any], map_id: int) -> list[SurfacePatch]:
    """The support surfaces of all upright objects, in world coordinates."""
    rows = connection.execute(
        "SELECT e.id, ST_ZMin(w.box), s.height, ST_AsBinary(s.outline), w.pose FROM entity e "
        "JOIN world w ON w.entity_id = e.id JOIN entity_model em ON em.entity_id = e.id "
        "JOIN support_surface s ON s.model_id = em.model_id AND s.height IS NOT NULL "
        "WHERE e.map_id = %s AND e.kind = 'object' AND abs(w.pose[4]) < 1e-3 "
        "AND abs(w.pose[5]) < 1e-3 AND NOT coalesce(e.type = ANY (ARRAY("
        "SELECT sub FROM type_closure WHERE super = ANY(%s))), false)",
        (map_id, list(BUILDING)),
    ).fetchall()
    patches = []
    for entity_id, low, height, outline, pose in rows:
        placed = Pose(*pose)
        ground = _placed(shapely.from_wkb(bytes(outline)), placed)
        patches.append(SurfacePatch(entity_id, low, placed.z + height, ground))
    return patches


def _placed(outline: Polygon, pose: Pose) -> Polygon:
    r = pose.rotation
    return affine_transform(outline, [r[0, 0], r[0, 1], r[1, 0], r[1, 1], pose.x, pose.y])


def _rooms(connection: psycopg.Connection[Any], map_id: int) -> list[RoomSpace]:
    rows = connection.execute(
        "SELECT e.id, ST_AsBinary(w.footprint), w.pose[3] + r.floor, "
        "coalesce(w.pose[3] + r.ceiling, greatest(ST_ZMax(w.box), w.pose[3] + r.floor + 2.5)) "
        "FROM entity e JOIN room r ON r.entity_id = e.id JOIN world w ON w.entity_id = e.id "
        "WHERE e.map_id = %s AND w.footprint IS NOT NULL",
        (map_id,),
    ).fetchall()
    return [RoomSpace(i, shapely.from_wkb(bytes(f)), low, high) for i, f, low, high in rows]
