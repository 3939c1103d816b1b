"""The topology of the current map, read from the database: the one module here that does so."""

from __future__ import annotations

from sqlalchemy import Connection, text

from planner.topology import OUTSIDE, Connector, Place, Topology
from semmap.geometry.pose import Pose

__all__ = ["read_places_like", "read_topology"]

_PLACES = """
SELECT e.name, e.type, e.label, s.name AS storey, l.name AS elevator
FROM room r JOIN entity e ON e.id = r.entity_id LEFT JOIN world w ON w.entity_id = e.id
     LEFT JOIN entity s ON s.id = w.storey_id LEFT JOIN entity l ON l.id = r.elevator_id
WHERE e.map_id = current_map() ORDER BY e.name
"""

_CONNECTORS = """
SELECT e.name, a.name AS place_a, b.name AS place_b, w.pose, c.pose_a, c.pose_b, c.form,
       c.direction, c.state, c.behaviour, c.width
FROM connector c JOIN entity e ON e.id = c.entity_id JOIN world w ON w.entity_id = e.id
     JOIN room ra ON ra.entity_id = c.place_a JOIN entity a ON a.id = c.place_a
     LEFT JOIN entity b ON b.id = c.place_b
WHERE e.map_id = current_map()
      AND (c.place_b IS NULL OR EXISTS (SELECT FROM room rb WHERE rb.entity_id = c.place_b))
ORDER BY e.name
"""

_ROOM_OF = """
WITH RECURSIVE up (id, holder_id) AS (
    SELECT e.id, p.holder_id FROM entity e LEFT JOIN placement p ON p.entity_id = e.id
    WHERE e.map_id = current_map() AND e.name = :name
    UNION ALL
    SELECT p.entity_id, p.holder_id FROM up JOIN placement p ON p.entity_id = up.holder_id
)
SELECT e.name FROM up JOIN room r ON r.entity_id = up.id JOIN entity e ON e.id = up.id LIMIT 1
"""


def read_topology(connection: Connection) -> Topology:
    """The rooms of the current map as places, and the connectors with poses in the map's frame."""
    places = [
        Place(row.name, row.type, row.label, row.storey, row.elevator)
        for row in connection.execute(text(_PLACES))
    ]
    connectors = []
    for row in connection.execute(text(_CONNECTORS)):
        frame = Pose(*row.pose)
        connectors.append(
            Connector(
                name=row.name,
                places=(row.place_a, row.place_b or OUTSIDE),
                poses=(frame @ Pose(*row.pose_a), frame @ Pose(*row.pose_b)),
                type=row.form,
                direction=row.direction,
                state=row.state,
                behaviour=row.behaviour,
                width=row.width,
            )
        )
    return Topology.of(places, connectors)


def read_places_like(connection: Connection, topology: Topology, said: str) -> list[str]:
    """The places that a person may mean: of that name, else the room of a thing, else by label.

    ``kitchen`` means the rooms whose label or type (with subtypes) is kitchen; ``muffin1`` the
    room that holds it. Empty where nothing fits.
    """
    if said in topology.places:
        return [said]
    holder = connection.execute(text(_ROOM_OF), {"name": said}).scalar()
    if holder is not None:
        return [str(holder)]
    subtypes = set(
        connection.execute(
            text("SELECT sub FROM type_closure WHERE super = :type"), {"type": said}
        ).scalars()
    )
    return [p.name for p in topology.places.values() if p.label == said or p.type in subtypes]
