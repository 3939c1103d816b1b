"""Finds the entities of a map that a word may stand for."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

import shapely
from sqlalchemy import text

from planner.location import EntityLookup, LocatedEntity
from semmap.geometry.pose import Pose
from semmap.query.snapshot import Snapshot

_FIND = """
WITH wanted AS (
    SELECT e.id FROM entity e WHERE e.map_id = current_map() AND e.name = :word
    UNION
    SELECT e.id FROM entity e WHERE e.map_id = current_map() AND e.label = :word
      AND NOT EXISTS (SELECT FROM entity n WHERE n.map_id = current_map() AND n.name = :word)
    UNION
    SELECT e.id FROM type_closure t JOIN entity e ON e.type = t.sub
    WHERE t.super = :word AND e.map_id = current_map()
      AND NOT EXISTS (SELECT FROM entity n WHERE n.map_id = current_map() AND n.name = :word)
    UNION
    SELECT g.entity_id FROM region g JOIN entity e ON e.id = g.entity_id
    WHERE e.map_id = current_map() AND g.origin = 'drawn'
      AND (e.properties->>CAST(:word AS text) = 'true'
           OR e.type = ANY (subtypes(CAST(:word AS text) || '_region')))
      AND NOT EXISTS (SELECT FROM entity n WHERE n.map_id = current_map() AND n.name = :word)
)
SELECT e.id, e.name, e.kind, e.type, e.label, w.pose, h.name AS place,
       g.entity_id IS NOT NULL AS is_region,
       ST_AsBinary(w.footprint) AS footprint, ST_ZMin(w.box) AS low, ST_ZMax(w.box) AS high,
       (SELECT n.name FROM world rw JOIN entity n ON n.id = rw.entity_id
        WHERE h.id IS NULL AND e.kind = 'region' AND n.kind = 'room' AND n.map_id = e.map_id
          AND rw.storey_id IS NOT DISTINCT FROM coalesce(w.storey_id, rw.storey_id)
          AND ST_Intersects(rw.footprint, coalesce(
              ST_PointOnSurface(w.footprint), ST_Point(w.pose[1], w.pose[2]))) LIMIT 1) AS around
FROM wanted q JOIN entity e ON e.id = q.id LEFT JOIN world w ON w.entity_id = e.id
LEFT JOIN entity h ON h.id = room_of(e.id) LEFT JOIN region g ON g.entity_id = e.id
WHERE e.kind IN ('room', 'object', 'region', 'agent')
ORDER BY e.name LIMIT 1000
"""

_NAMES = """
SELECT DISTINCT unnest(ARRAY[type, label]) FROM entity
WHERE map_id = current_map() AND kind IN ('room', 'object', 'region')
UNION
(SELECT name FROM entity WHERE map_id = current_map()
 AND kind IN ('room', 'object', 'region', 'agent') ORDER BY name ILIKE :start DESC LIMIT 10000)
"""

_PLACE_AT = """
SELECT e.name FROM world w JOIN entity e ON e.id = w.entity_id JOIN room r ON r.entity_id = e.id
WHERE e.map_id = current_map() AND ST_Covers(w.footprint, ST_MakePoint(:x, :y))
  AND w.pose[3] + r.floor <= :z + 0.5 ORDER BY w.pose[3] + r.floor DESC LIMIT 1
"""


class MapLookup(EntityLookup):
    """An `EntityLookup` in the present state of a map."""

    def __init__(self, snapshot: Callable[[], AbstractContextManager[Snapshot]]) -> None:
        self._snapshot = snapshot

    def find(self, word: str) -> list[LocatedEntity]:
        """The entity of this name, or else all entities of this label or type."""
        with self._snapshot() as seen:
            return find_entities(seen, word)

    def place_at(self, pose: Pose) -> str | None:
        """The highest room in which a pose lies whose floor is not above it; None without one."""
        values = {"x": pose.x, "y": pose.y, "z": pose.z}
        with self._snapshot() as seen:
            name = seen.connection.execute(text(_PLACE_AT), values).scalar()
        return None if name is None else str(name)

    def similar_names(self, word: str) -> list[str]:
        """All types and labels of the map, and names, first those that begin like a word."""
        start = word[:2].replace("\\", r"\\").replace("%", r"\%").replace("_", r"\_") + "%"
        with self._snapshot() as seen:
            rows = seen.connection.execute(text(_NAMES), {"start": start}).scalars().all()
        return [name for name in rows if name is not None]


def find_entities(seen: Snapshot, word: str) -> list[LocatedEntity]:
    """The entity of the current map with this name, or else all of this label or type.

    ``kitchen`` stands for the rooms whose label or type is kitchen, subtypes included; ``muffin1``
    for an object, in its room; ``home`` for a region of this name, of the type ``home_region`` or
    with the property ``home``. A region in several rooms is reached in the one of its middle.
    """
    rows = seen.connection.execute(text(_FIND), {"word": word}).all()
    return [
        LocatedEntity(
            row.name,
            row.kind,
            row.name if row.kind == "room" else row.place or row.around,
            None if row.pose is None else Pose(*row.pose),
            None if row.footprint is None else shapely.from_wkb(bytes(row.footprint)),
            None if row.low is None else (row.low, row.high),
            row.id,
        )
        for row in rows
    ]
