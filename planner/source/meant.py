"""What in the current map a person may mean by a word, and where."""

from __future__ import annotations

import shapely
from sqlalchemy import Connection, text

from planner.target import Target
from planner.topology import Topology
from semmap.geometry.pose import Pose

__all__ = ["read_names_like", "read_place_at", "read_places_like", "read_targets"]

_TARGETS = """
WITH RECURSIVE wanted AS (
    SELECT e.id FROM entity e WHERE e.map_id = current_map() AND e.name = :said
    UNION
    SELECT e.id FROM entity e WHERE e.map_id = current_map() AND e.label = :said
      AND NOT EXISTS (SELECT FROM entity n WHERE n.map_id = current_map() AND n.name = :said)
    UNION
    SELECT e.id FROM type_closure t JOIN entity e ON e.type = t.sub
    WHERE t.super = :said AND e.map_id = current_map()
      AND NOT EXISTS (SELECT FROM entity n WHERE n.map_id = current_map() AND n.name = :said)
), up (id, at, depth) AS (
    SELECT id, id, 0 FROM wanted
    UNION ALL
    SELECT u.id, p.holder_id, u.depth + 1 FROM up u JOIN placement p ON p.entity_id = u.at
    WHERE p.holder_id IS NOT NULL AND NOT EXISTS (SELECT FROM room r WHERE r.entity_id = u.at)
), held AS (
    SELECT DISTINCT ON (u.id) u.id, e.name AS place
    FROM up u JOIN room r ON r.entity_id = u.at JOIN entity e ON e.id = u.at ORDER BY u.id, u.depth
)
SELECT e.id, e.name, e.kind, e.type, e.label, w.pose, h.place, g.entity_id IS NOT NULL AS is_region,
       ST_AsBinary(w.footprint) AS footprint, ST_ZMin(w.box) AS low, ST_ZMax(w.box) AS high,
       (SELECT n.name FROM world rw JOIN entity n ON n.id = rw.entity_id
        WHERE h.place IS NULL AND n.kind = 'room' AND n.map_id = e.map_id
          AND rw.storey_id IS NOT DISTINCT FROM coalesce(w.storey_id, rw.storey_id)
          AND ST_Intersects(rw.footprint, ST_PointOnSurface(w.footprint)) LIMIT 1) AS around
FROM wanted q JOIN entity e ON e.id = q.id LEFT JOIN world w ON w.entity_id = e.id
LEFT JOIN held h ON h.id = e.id LEFT JOIN region g ON g.entity_id = e.id
WHERE e.kind IN ('room', 'object', 'region', 'agent')
ORDER BY e.name LIMIT :most
"""


def read_targets(connection: Connection, said: str, most: int = 1000) -> list[Target]:
    """What a person may mean: the entity of that name, else those of that label or type.

    ``kitchen`` means the rooms whose label or type (with subtypes) is kitchen; ``muffin1`` a thing,
    in the room that holds it; ``home`` a region. Empty where nothing fits.
    """
    rows = connection.execute(text(_TARGETS), {"said": said, "most": most}).all()
    return [
        Target(
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


_NAMES = """
SELECT DISTINCT unnest(ARRAY[type, label]) FROM entity
WHERE map_id = current_map() AND kind IN ('room', 'object', 'region')
UNION
(SELECT name FROM entity WHERE map_id = current_map() AND name ILIKE :start
 AND kind IN ('room', 'object', 'region', 'agent') LIMIT 2000)
"""


def read_names_like(connection: Connection, said: str) -> list[str]:
    """Types, labels, and names that begin as a word does that means nothing."""
    start = said[:2].replace("\\", r"\\").replace("%", r"\%").replace("_", r"\_") + "%"
    rows = connection.execute(text(_NAMES), {"start": start}).scalars()
    return [name for name in rows if name is not None]


def read_place_at(connection: Connection, pose: Pose) -> str | None:
    """The room of the current map in which a pose is; the highest whose floor is not above it."""
    name = connection.execute(
        text(
            "SELECT e.name FROM world w JOIN entity e ON e.id = w.entity_id "
            "JOIN room r ON r.entity_id = e.id WHERE e.map_id = current_map() "
            "AND ST_Covers(w.footprint, ST_MakePoint(:x, :y)) "
            "AND w.pose[3] + r.floor <= :z + 0.5 ORDER BY w.pose[3] + r.floor DESC LIMIT 1"
        ),
        {"x": pose.x, "y": pose.y, "z": pose.z},
    ).scalar()
    return None if name is None else str(name)


def read_places_like(connection: Connection, topology: Topology, said: str) -> list[str]:
    """The places that a person may mean: of that name, of a thing of that name, by label or type.

    Empty where nothing fits.
    """
    if said in topology.places:
        return [said]
    found = [target.place for target in read_targets(connection, said)]
    return [*dict.fromkeys(place for place in found if place in topology.places)]
