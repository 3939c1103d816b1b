"""The walls of rooms that are drawn as outlines where the map has no walls.

Without them, a robot that passes a narrow place beside its outline would reach through a wall.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from semmap.query.storey_scene import Bounds, FloorArea, SceneEntity

NEAR, STEP, ENCLOSED = 0.5, 0.25, 0.5
"""Metres within which a wall is at an outline, and between the points of the outline at which one
is looked for; the part of these that are at walls in a room which has walls."""

LOWEST = 0.5
"""Metres above the floor that a wall is at least high; what begins higher is a ceiling or beam."""

CLEAR = 0.01
"""Metres beside doorways, and within the borders of other rooms, in which no wall is."""


def with_outline_walls(
    entities: Sequence[SceneEntity], floors: Sequence[FloorArea], bounds: Bounds | None = None
) -> tuple[SceneEntity, ...]:
    """Return the entities of a scene, where rooms without walls have those of their outlines.

    They stand from floor to ceiling, without thickness, except in doorways and inside of other
    rooms. `floors` are the rooms and doorways of the scene; what is outside of `bounds` is not
    known.
    """
    shown = {area.name for area in floors}
    drawn = [
        e
        for e in entities
        if e.kind == "room" and e.name in shown and e.footprint is not None
        if e.voxels is None and not len(e.triangles)
    ]
    walled = _have_walls(drawn, entities, bounds)
    bare = [room for room, has in zip(drawn, walled, strict=True) if not has]
    if not bare:
        return tuple(entities)
    names = {e.name for e in entities if e.kind == "room"}
    doorways = [a.outline.buffer(CLEAR) for a in floors if a.name not in names]
    areas = [room.footprint.buffer(-CLEAR) for room in drawn if room.footprint is not None]
    free = [*areas, *doorways]
    tree = shapely.STRtree(free)
    walls = {}
    for room in bare:
        assert room.footprint is not None
        assert room.floor is not None
        assert room.ceiling is not None
        line = room.footprint.boundary
        for k in tree.query(line, "intersects"):
            if k >= len(drawn) or drawn[k].floor == room.floor:
                line = line.difference(free[k])
        walls[room.id] = replace(room, triangles=_upright(line, room.floor, room.ceiling))
    return tuple(walls.get(e.id, e) for e in entities)


def is_wall(entity: SceneEntity) -> bool:
    """Return True for an object of which walls are made, and not a leaf of a door."""
    return "building_element" in entity.types and "door_leaf" not in entity.types


def _have_walls(
    rooms: Sequence[SceneEntity], entities: Sequence[SceneEntity], bounds: Bounds | None
) -> list[bool]:
    """Whether walls or the shells of other rooms enclose rooms, or a building in one piece."""
    solids = [e for e in entities if e.kind in ("object", "room") and e.heights is not None]
    if not rooms or not solids:
        return [False for _ in rooms]
    heights = np.array([e.heights for e in solids])
    boxes = shapely.box(*np.array([e.bounds for e in solids]).T)
    kept = np.array([e.kind == "room" or is_wall(e) for e in solids])
    outlines = [
        e.footprint if e.footprint is not None else box
        for e, box in zip(solids, boxes, strict=True)
    ]
    walls = shapely.STRtree(np.array(outlines)[kept])
    pieces = shapely.STRtree(boxes)
    found = []
    for room in rooms:
        assert room.footprint is not None
        assert room.floor is not None
        level = room.floor + LOWEST
        high = (heights[:, 0] <= level) & (heights[:, 1] >= level)
        around = pieces.query(shapely.box(*room.footprint.bounds), "covered_by")
        points = shapely.get_coordinates(shapely.segmentize(room.footprint.boundary, STEP))
        if bounds is not None:
            low, top = np.add(bounds[:2], NEAR), np.subtract(bounds[2:], NEAR)
            points = points[((points >= low) & (points <= top)).all(axis=1)]
        at, wall = walls.query(shapely.points(points), "dwithin", NEAR)
        near = np.unique(at[high[kept][wall]])
        found.append(bool(high[around].any()) or len(near) >= ENCLOSED * len(points))
    return found


def _upright(lines: shapely.Geometry, low: float, high: float) -> NDArray[np.float64]:
    """The (F, 3, 3) triangles of upright faces over lines, between two heights z."""
    parts = [shapely.get_coordinates(part) for part in shapely.get_parts(lines)]
    ends = [np.stack([part[:-1], part[1:]], axis=1) for part in parts]
    a, b = np.concatenate([*ends, np.empty((0, 2, 2))]).swapaxes(0, 1)
    foot, after, head, end = (
        np.column_stack([p, np.full(len(p), z)]) for z in (low, high) for p in (a, b)
    )
    return np.concatenate([np.stack([foot, after, end], 1), np.stack([foot, end, head], 1)])
