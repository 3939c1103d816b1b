"""Outlines and cabins of the current map: the one module here that reads the database."""

from __future__ import annotations

import shapely
from shapely import MultiPolygon, Polygon
from sqlalchemy import Connection, text

from planner.exchange.surroundings import Cabin, Surroundings
from semmap.geometry.pose import Pose

__all__ = ["read_surroundings"]

_ROOMS = """
SELECT e.name, l.name AS elevator, w.pose, ST_AsBinary(w.footprint) AS outline
FROM room r JOIN entity e ON e.id = r.entity_id JOIN world w ON w.entity_id = e.id
     LEFT JOIN entity l ON l.id = r.elevator_id
WHERE e.map_id = current_map() AND w.footprint IS NOT NULL ORDER BY e.name
"""


def read_surroundings(connection: Connection) -> Surroundings:
    """The outlines of all rooms, and of each elevator the cabin on the first of its storeys."""
    outlines: dict[str, Polygon | MultiPolygon] = {}
    cabins: dict[str, Cabin] = {}
    for row in connection.execute(text(_ROOMS)):
        outline = shapely.from_wkb(bytes(row.outline))
        if not isinstance(outline, Polygon | MultiPolygon):
            continue
        outlines[row.name] = outline
        if row.elevator is not None:
            cabins.setdefault(row.elevator, _cabin(Pose(*row.pose), outline))
    return Surroundings(outlines, cabins)


def _cabin(pose: Pose, outline: Polygon | MultiPolygon) -> Cabin:
    """The box around a cabin along the axes of its own frame."""
    own = shapely.affinity.rotate(outline, -pose.yaw, origin=(pose.x, pose.y), use_radians=True)
    x0, y0, x1, y1 = own.bounds
    (middle,) = shapely.affinity.rotate(
        shapely.Point((x0 + x1) / 2, (y0 + y1) / 2),
        pose.yaw,
        origin=(pose.x, pose.y),
        use_radians=True,
    ).coords
    return Cabin(middle[0], middle[1], pose.yaw, x1 - x0, y1 - y0)
