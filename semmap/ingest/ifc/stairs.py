"""The stairs and ramps of an IFC building: ways from a room to one at another height."""

from __future__ import annotations

from typing import Literal

import numpy as np
from shapely import Point

from semmap.geometry.pose import Pose
from semmap.ingest.ifc.building import IfcBuilding, IfcRoom
from semmap.ingest.stairs import notes_on_ends, walked_corners, way_ends, way_entry

NEAR = 1.0
"""Metres from a room and its floor within which a way ends there."""

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
            first, second = (_room_at(building, *end.stands().tolist()) for end in ends)
            if first is None or second is None or first.name == second.name:
                building.skip(way, "does not lead from a room to another", "Draw a connector.")
                continue
            floors = first.floor, second.floor
            places = first.name, second.name
            stands = np.array([ends[0].stands(first.outline), ends[1].stands(second.outline)])
            entry = way_entry(building.name_of(way), type_, stands, places, floors)
            assert entry.pose is not None
            up = Pose(z=first.storey.elevation)
            entry.holder, entry.pose = first.storey.name, up.inverse() @ entry.pose
            name = building.add(entry, way)
            rooms = [(room.name, room.outline) for room in (first, second)]
            building.out.notes += notes_on_ends(name, ends, rooms)


def _room_at(building: IfcBuilding, x: float, y: float, z: float) -> IfcRoom | None:
    """The room in which, or else nearest to which, a way ends, by its outline and its floor."""
    away = {
        space: (space.outline.distance(Point(x, y)), abs(space.floor - z))
        for space in building.spaces
    }
    near = [space for space, metres in away.items() if max(metres) <= NEAR]
    return min(near, key=lambda space: sum(away[space]), default=None)
