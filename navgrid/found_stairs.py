"""Stairs found in geometry: objects whose treads rise from the floor of a storey to the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon, Point, Polygon

from navgrid.found_rooms import FoundRooms, FoundStairs
from semmap.ingest.stairs import notes_on_ends, walked_corners, way_ends
from semmap.query.storey_scene import SceneEntity, StoreyScene

RISERS = (0.1, 0.25)
"""Least and largest height of a step, metres."""

FLAT = 0.999
"""The least vertical part of the normal of a tread: a ramp has none."""

NEAR = 1.0
"""Metres from a room within which stairs end there."""


def with_stairs(scenes: Sequence[StoreyScene], found: Sequence[FoundRooms]) -> list[FoundRooms]:
    """Return what was found on each storey, from the lowest, with the stairs to the next one.

    Stairs are objects with treads; those at whose place the map has stairs already are left out.
    """
    by_storey = {each.storey: each for each in found}
    for lower, upper in pairwise(scenes):
        here, above = by_storey[lower.storey], by_storey[upper.storey]
        entities = {e.name: e for scene in (lower, upper) for e in scene.entities}.values()
        known = [entity for entity in entities if entity.form == "stairs"]
        stairs: list[FoundStairs] = []
        notes: list[str] = []
        for entity in entities:
            walked = _flight(entity, lower.elevation, upper.elevation)
            if walked is None:
                continue
            ends = way_ends(walked)
            first = _room_at(lower, here, Point(ends[0].stands()[:2]))
            second = _room_at(upper, above, Point(ends[1].stands()[:2]))
            if first is None or second is None:
                continue
            stands = np.array([ends[0].stands(first[1]), ends[1].stands(second[1])])
            if not any(_is_same(each, stands) for each in known):
                name = f"{lower.storey}_stairs{len(stairs) + 1}"
                floors = lower.elevation, upper.elevation
                rooms = first[0], second[0]
                stairs.append(FoundStairs(name, rooms, stands, floors, entity.name))
                notes += notes_on_ends(name, ends, (first, second))
        by_storey[lower.storey] = replace(here, stairs=tuple(stairs), notes=tuple(notes))
    return [by_storey[scene.storey] for scene in scenes]


def _flight(entity: SceneEntity, floor: float, above: float) -> NDArray[np.float64] | None:
    """The corners (N, 3) of an object's treads, if these rise by steps from a floor to the next."""
    if entity.kind != "object" or entity.heights is None or not len(entity.triangles):
        return None
    if entity.heights[0] > floor + RISERS[1] or entity.heights[1] < above - 2 * RISERS[1]:
        return None
    walked = walked_corners(entity.triangles, FLAT)
    walked = walked[(walked[:, 2] > floor + RISERS[0] / 2) & (walked[:, 2] < above + RISERS[0])]
    heights = np.unique(np.round(walked[:, 2], 2))
    if not len(heights) or np.diff(heights, prepend=floor, append=above).max() > RISERS[1]:
        return None
    foot, head = (end.stands() for end in way_ends(walked))
    run = float(np.hypot(*(head - foot)[:2]))
    return walked if run >= above - floor else None  # shelves have no run


def _room_at(
    scene: StoreyScene, found: FoundRooms, at: Point
) -> tuple[str, Polygon | MultiPolygon] | None:
    """The room of a storey, found or known, that is nearest to a point, and its outline."""
    outlines: dict[str, Polygon | MultiPolygon] = {
        e.name: e.footprint for e in scene.entities if e.kind == "room" and e.footprint is not None
    }
    outlines |= {room.name: room.outline for room in found.rooms}
    nearest = min(outlines.items(), key=lambda room: room[1].distance(at), default=None)
    return nearest if nearest is not None and nearest[1].distance(at) <= NEAR else None


def _is_same(stairs: SceneEntity, ends: NDArray[np.float64]) -> bool:
    """Whether stairs of the map begin and end near the ends of others."""
    assert stairs.sides is not None
    sides = np.array([pose.translation[:2] for pose in stairs.sides])
    return bool((np.hypot(*(sides - ends[:, :2]).T) <= NEAR).all())
