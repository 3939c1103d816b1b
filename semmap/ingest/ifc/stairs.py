"""The stairs and ramps of an IFC building: ways from a room of one storey to one of another."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Point

from semmap.geometry.pose import Pose
from semmap.ingest.ifc.building import IfcBuilding, Space
from semmap.ingest.openings import BEHAVIOURS
from semmap.ingest.world import ConnectorDetail, Entry

STEP, RUN = 0.3, 1.0
"""Metres of height: of the treads at an end of a way, and of those that show its direction."""

LEVEL = 0.9
"""The least vertical part of the normal of what one walks on."""

STANDING = 0.5
"""Metres before the first tread and behind the last at which a robot stands."""

NEAR = 1.0
"""Metres from a room and its storey within which a way ends there."""

WAYS = {"IfcStair": "stairs", "IfcRamp": "ramp"}
"""The type of the connector, by class."""


def add_stairs(building: IfcBuilding) -> None:
    """Add the stairs and ramps whose ends lie in two rooms."""
    from ifcopenshell.util.element import get_decomposition

    for class_, type_ in WAYS.items():
        for way in building.file.of(class_):
            flights = [e for e in get_decomposition(way) if e.is_a(f"{class_}Flight")]
            solids = list(filter(None, map(building.file.solid, flights or [way])))
            walked = _walked(np.concatenate([s.triangles for s in solids])) if solids else None
            if walked is None or not len(walked):
                building.skip(way, "has no surface to walk on", "Export it with its geometry.")
                continue
            ends = _end(walked, 1.0), _end(walked, -1.0)
            first, second = (_room_at(building, end) for end in ends)
            if first is None or second is None or first.name == second.name:
                building.skip(way, "does not lead from a room to another", "Draw a connector.")
                continue
            _add_way(
                building,
                Entry(building.name_of(way), "connector", type_),
                way,
                ends,
                (first, second),
            )


def _add_way(
    building: IfcBuilding,
    entry: Entry,
    way: Any,
    ends: tuple[NDArray[np.float64], NDArray[np.float64]],
    rooms: tuple[Space, Space],
) -> None:
    """Add a connector along a way, from its lower to its upper room."""
    lower, upper = (room.storey for room in rooms)
    (ax, ay, _), (bx, by, _) = (end.tolist() for end in ends)
    half, yaw = np.hypot(bx - ax, by - ay) / 2, np.arctan2(by - ay, bx - ax)
    rise = upper.elevation - lower.elevation
    entry.holder, entry.pose = lower.name, Pose.planar((ax + bx) / 2, (ay + by) / 2, float(yaw))
    entry.detail = ConnectorDetail(
        (rooms[0].name, rooms[1].name),
        (Pose.planar(-half, 0.0), Pose.planar(half, 0.0, np.pi, rise)),
        type="ramp" if entry.type == "ramp" else "stairs",
        behaviour=BEHAVIOURS[entry.type or "stairs"],
    )
    building.add(entry, way)


def _walked(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """The corners (N, 3) of the level triangles whose upper side can be walked on."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    walked: NDArray[np.float64] = triangles[normals[:, 2] > LEVEL * np.maximum(length, 1e-9)]
    return walked.reshape(-1, 3)


def _end(walked: NDArray[np.float64], up: float) -> NDArray[np.float64]:
    """Where a robot stands before the lower end of a way (`up` 1) or behind the upper (-1)."""
    height = up * walked[:, 2] - (up * walked[:, 2]).min()
    end, next_ = walked[height <= STEP], walked[(height > STEP) & (height <= STEP + RUN)]
    middle = end.mean(axis=0)
    away = middle - (next_ if len(next_) else walked).mean(axis=0)
    away[2] = 0.0
    away /= max(float(np.linalg.norm(away)), 1e-9)
    edge = float(((end - middle) @ away).max())
    stands: NDArray[np.float64] = middle + (edge + STANDING) * away
    return stands


def _room_at(building: IfcBuilding, end: NDArray[np.float64]) -> Space | None:
    """The room of the storey at a height in which, or else nearest to which, a way ends."""
    x, y, z = end.tolist()
    near = [s for s in building.spaces if abs(s.storey.elevation - z) <= NEAR]
    nearest = min(near, key=lambda space: space.outline.distance(Point(x, y)), default=None)
    if nearest is None or nearest.outline.distance(Point(x, y)) > NEAR:
        return None
    return nearest
