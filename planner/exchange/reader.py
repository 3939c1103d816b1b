"""Reads the outlines of rooms, cabins of elevators and drawn lanes from the current map."""

from __future__ import annotations

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon
from sqlalchemy import text

from planner.exchange.route_graph import BuildingOutline, Cabin, DrawnLane
from semmap.geometry.extent import extent
from semmap.geometry.overlay import united, without
from semmap.geometry.pose import Pose
from semmap.query.snapshot import Snapshot

_ROOMS = """
SELECT e.name, w.storey_id, l.name AS elevator, w.pose, ST_AsBinary(w.footprint) AS outline
FROM room r JOIN entity e ON e.id = r.entity_id JOIN world w ON w.entity_id = e.id
     LEFT JOIN entity l ON l.id = r.elevator_id
WHERE e.map_id = current_map() AND w.footprint IS NOT NULL ORDER BY e.name
"""

_WALLS = """
SELECT w.storey_id, ST_AsBinary(w.footprint) AS outline
FROM object_type o JOIN world w ON w.entity_id = o.id
WHERE o.map_id = current_map() AND o.type = 'wall' AND w.footprint IS NOT NULL
"""

_LANES = """
SELECT a.name, b.name, l.properties FROM link l
JOIN entity a ON a.id = l.from_id JOIN entity b ON b.id = l.to_id
WHERE a.map_id = current_map() AND l.relation = 'lane' ORDER BY a.name, b.name
"""

MOST_WALL = 0.3
"""Share of a room above which a footprint is not a wall, but the hull of walls around the room."""


def read_building_outline(seen: Snapshot) -> BuildingOutline:
    """The outlines of all rooms without walls, each elevator's cabin on one storey, and lanes."""
    standing: dict[int | None, list[shapely.Geometry]] = {}
    for row in seen.connection.execute(text(_WALLS)):
        standing.setdefault(row.storey_id, []).append(shapely.from_wkb(bytes(row.outline)))
    walls = {storey: united(parts) for storey, parts in standing.items()}
    outlines: dict[str, Polygon | MultiPolygon] = {}
    cabins: dict[str, Cabin] = {}
    for row in seen.connection.execute(text(_ROOMS)):
        outline = shapely.from_wkb(bytes(row.outline))
        if not isinstance(outline, Polygon | MultiPolygon):
            continue
        outlines[row.name] = _free(outline, walls.get(row.storey_id))
        if row.elevator is not None:
            cabins.setdefault(row.elevator, _cabin(Pose(*row.pose), outline))
    lanes = tuple(DrawnLane(*row) for row in seen.connection.execute(text(_LANES)))
    return BuildingOutline(outlines, cabins, lanes)


def _free(
    outline: Polygon | MultiPolygon, walls: shapely.Geometry | None
) -> Polygon | MultiPolygon:
    if walls is None:
        return outline
    rest = without(outline, walls)
    whole = isinstance(rest, Polygon | MultiPolygon)
    return rest if whole and rest.area >= (1 - MOST_WALL) * outline.area else outline


def _cabin(pose: Pose, outline: Polygon | MultiPolygon) -> Cabin:
    """The box around a cabin along the axes of its own frame."""
    corners = shapely.get_coordinates(outline)
    frame = Pose.planar(pose.x, pose.y, pose.yaw)
    low, high = extent(frame.inverse().apply(np.pad(corners, ((0, 0), (0, 1)))))
    x, y, _ = frame.apply([(low + high) / 2])[0].tolist()
    width, depth, _ = (high - low).tolist()
    return Cabin(x, y, pose.yaw, width, depth)
