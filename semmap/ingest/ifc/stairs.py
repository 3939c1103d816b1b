"""The stairs and ramps of an IFC building: ways from a room of one storey to one of another."""

from __future__ import annotations

from typing import Literal

import numpy as np
from shapely import Point

from semmap.geometry.pose import Pose
from semmap.ingest.ifc.building import IfcBuilding, IfcRoom
from semmap.ingest.stairs import walked_corners, way_ends, way_entry

NEAR = 1.0
"""Metres from a room and its storey within which a way ends there."""

WAYS: dict[str, Literal["stairs", "ramp"]] = {"IfcStair": "stairs", "IfcRamp": "ramp"}
"""The type of the connector, by class."""


def add_stairs(building: IfcBuilding) -> None:
    """Add the stairs and ramps whose ends lie in two rooms."""
    from ifcopenshell.util.element import get_decomposition

    for class_, type_ in WAYS.items():
        for way in building.file.of(class_):
            flights = [e for e in get_decomposition(way) if e.is_a(f"{class_}Flight")]
            solids = list(filter(None, map(building.file.solid, flights or [way])))
            walked = [walked_corners(solid.triangles) for solid in solids]
            if not sum(map(len, walked)):
                building.skip(way, "has no surface to walk on", "Export it with its geometry.")
                continue
            ends = way_ends(np.concatenate(walked))
            first, second = (_room_at(building, *end) for end in ends.tolist())
            if first is None or second is None or first.name == second.name:
                building.skip(way, "does not lead from a room to another", "Draw a connector.")
                continue
            floors = first.storey.elevation, second.storey.elevation
            places = first.name, second.name
            entry = way_entry(building.name_of(way), type_, ends, places, floors)
            assert entry.pose is not None
            entry.holder, entry.pose = first.storey.name, Pose(z=-floors[0]) @ entry.pose
            building.add(entry, way)


def _room_at(building: IfcBuilding, x: float, y: float, z: float) -> IfcRoom | None:
    """The room of the storey at a height in which, or else nearest to which, a way ends."""
    near = [s for s in building.spaces if abs(s.storey.elevation - z) <= NEAR]
    nearest = min(near, key=lambda space: space.outline.distance(Point(x, y)), default=None)
    if nearest is None or nearest.outline.distance(Point(x, y)) > NEAR:
        return None
    return nearest
