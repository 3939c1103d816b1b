"""Lifts found in geometry: shafts without a floor, with a doorway on each storey."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count, pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon

from navgrid.found_rooms import FoundLift, FoundRoom, FoundRooms
from semmap.geometry.overlay import common, united
from semmap.query.storey_scene import StoreyScene

CABIN = (1.0, 7.0)
"""Least and largest area of a lift's shaft, square metres: of a person's to that of a bed's."""

SAME = 0.7
"""The part that two storeys' rooms share of the area of both together, if they are one shaft."""

SLAB = 0.4
"""Metres above and below the z of a storey in which its floor lies."""

OPEN, COVERED = 0.2, 0.8
"""The floor's share of a shaft, at most, and of the room before it, at least: where a map has no
floors, their absence tells nothing."""


def with_lifts(scenes: Sequence[StoreyScene], found: Sequence[FoundRooms]) -> list[FoundRooms]:
    """Return what was found on each storey, from the lowest, with the lifts that begin there.

    A lift is a chain of rooms found above each other, of a cabin's size, without stairs. Each has a
    doorway, and between them the floor is missing that the rooms before the doorways have.
    """
    shafts: list[list[tuple[str, FoundRoom]]] = []
    for lower, upper in pairwise(range(len(scenes))):
        floor = _floor(scenes[lower : upper + 1], scenes[upper].elevation)
        for above in found[upper].rooms:
            below = next((r for r in found[lower].rooms if _is_above(r.outline, above)), None)
            if (
                below is None
                or not _is_shaft(above, found[upper], floor)
                or not _lobbies(below, found[lower])
                or any(below.outline.intersects(LineString(s.ends)) for s in found[lower].stairs)
            ):
                continue
            reached = next((s for s in shafts if s[-1] == (found[lower].storey, below)), None)
            if reached is None:
                reached = [(found[lower].storey, below)]
                shafts.append(reached)
            reached.append((found[upper].storey, above))
    by_storey = {each.storey: each for each in found}
    taken = {entity.name for scene in scenes for entity in scene.entities}
    names = (name for n in count(1) if (name := f"lift{n}") not in taken)
    for name, shaft in zip(names, shafts, strict=False):
        first = by_storey[shaft[0][0]]
        lift = FoundLift(name, tuple(room.name for _, room in shaft))
        by_storey[first.storey] = replace(first, lifts=(*first.lifts, lift))
    return [by_storey[each.storey] for each in found]


def _is_above(outline: Polygon, room: FoundRoom) -> bool:
    """Whether a room is of a cabin's size, and lies above an outline."""
    low, high = CABIN
    if not (low <= room.outline.area <= high and low <= outline.area <= high):
        return False
    shared = common(room.outline, outline).area
    return bool(shared >= SAME * united([room.outline, outline]).area)


def _lobbies(room: FoundRoom, storey: FoundRooms) -> list[Polygon]:
    """The outlines of the rooms before the doorways of a room; empty without any."""
    others = {other for way in storey.doorways if room.name in way.joins for other in way.joins}
    return [each.outline for each in storey.rooms if each.name in others - {room.name}]


def _is_shaft(room: FoundRoom, storey: FoundRooms, floor: NDArray[np.object_]) -> bool:
    """Whether a room lacks the floor that the rooms before its doorways have."""
    lobbies = _lobbies(room, storey)
    return (
        bool(lobbies)
        and _share(room.outline, floor) <= OPEN
        and all(_share(lobby, floor) >= COVERED for lobby in lobbies)
    )


def _share(outline: Polygon, floor: NDArray[np.object_]) -> float:
    near = floor[shapely.intersects(floor, outline)]
    return float(united(common(each, outline) for each in near).area / outline.area)


def _floor(scenes: Sequence[StoreyScene], z: float) -> NDArray[np.object_]:
    """The level faces of objects at a height, as polygons."""
    entities = {e.id: e for scene in scenes for e in scene.entities if e.kind == "object"}
    flat = [np.empty((0, 3, 2))]
    for entity in entities.values():
        heights = entity.triangles[:, :, 2]
        at = (np.ptp(heights, axis=1) < 0.01) & (abs(heights.mean(axis=1) - z) <= SLAB)
        flat.append(entity.triangles[at][:, :, :2])
    made = shapely.polygons(np.concatenate(flat))
    return np.asarray(made[shapely.area(made) > 0])
