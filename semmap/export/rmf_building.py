"""A map as a ``building.yaml`` of Open-RMF, the file of its traffic editor, in metres.

A room is a floor, with half of each doorway in its walls; walls are the borders of floors, without
the lines of doors and openings. A named vertex in each room names it. Cabins are lifts. Lanes are
those that the map has drawn; `semmap topology --format rmf` writes a navigation graph without any.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import yaml
from shapely import LineString, MultiPolygon, Polygon

from semmap.export.features import MapFeature, MapFeatures
from semmap.geometry.morphology import polygons
from semmap.geometry.overlay import common, united, without
from semmap.geometry.pose import Pose
from semmap.ingest.annotation.connectors import OPENING
from semmap.ingest.annotation.feature_values import supertypes
from semmap.ingest.floor_plan import middle_of
from semmap.ingest.rmf.storey_entries import LANE_PROPERTIES, NAMES_ROOM, PLACE_TYPES

GRID = 1e-4
"""Metres to which coordinates are rounded."""

SHORTEST = 2e-3
"""Least length of a wall, metres."""

REACH = 0.35
"""Metres from the line of a door within which the room that it leads to begins."""

STANDS = 0.5
"""Metres below a level at which what has no storey is still on it."""

TYPES = {bool: 4, int: 2, float: 3, str: 1}
"""The numbers of the types of parameters."""

DOOR_TYPES = {
    "double_door": "double_hinged",
    "revolving_door": "hinged",
    "sliding_door": "sliding",
    "door": "hinged",
}
"""The type of door in the traffic editor for each of the T-Box, the first that fits."""

PARTS = {"wall", "floor", "ground", "ceiling", "roof", "window", "building_shell", "door_leaf"}
"""Types of objects that are parts of the building, not models in it."""

WALL = {"alpha": 1.0, "texture_height": 2.5, "texture_name": "default", "texture_scale": 1.0}
FLOOR = {
    "indoor": 0,
    "texture_name": "blue_linoleum",
    "texture_rotation": 0.0,
    "texture_scale": 1.0,
}
HINGES = {"motion_axis": "start", "motion_degrees": 90.0, "motion_direction": 1}


class _Level:
    """The vertices of a level, each place once, and what is drawn between them."""

    def __init__(self, elevation: float) -> None:
        self.numbers: dict[tuple[float, float, str], int] = {}
        self.vertices: list[list[Any]] = []
        self.data: dict[str, Any] = {"elevation": elevation, "vertices": self.vertices}
        self.data |= {key: [] for key in ("walls", "doors", "floors", "lanes", "models")}

    def vertex(self, x: float, y: float, name: str = "", **params: Any) -> int:
        key = (round(x, 4) + 0.0, round(y, 4) + 0.0, name)
        if key not in self.numbers:
            self.numbers[key] = len(self.vertices)
            self.vertices.append([*key[:2], 0.0, name, *([_params(params)] if params else [])])
        return self.numbers[key]

    def edge(self, what: str, line: Iterable[Sequence[float]], params: Mapping[str, Any]) -> None:
        (ax, ay), (bx, by) = (point[:2] for point in line)
        if math.dist((ax, ay), (bx, by)) >= SHORTEST:
            self.data[what].append([self.vertex(ax, ay), self.vertex(bx, by), _params(params)])


def _params(given: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Values as the traffic editor writes them, each with the number of its type."""
    return {k: [TYPES[type(v)], v] for k, v in given.items() if type(v) in TYPES}


def write_rmf(found: MapFeatures, path: Path) -> None:
    """Write a map as a building of Open-RMF."""
    path.write_text(
        yaml.safe_dump(
            rmf_building(found), allow_unicode=True, default_flow_style=None, sort_keys=False
        ),
        encoding="utf-8",
    )


def rmf_building(found: MapFeatures) -> dict[str, Any]:
    """A map as a building of Open-RMF; what has no storey is on the level below it."""
    storeys = [(s.name, float(s.keys.get("elevation", 0.0))) for s in found.all("storeys")]
    storeys = sorted(storeys, key=lambda each: each[1]) or [(found.name, 0.0)]
    levels = {name: _Level(elevation) for name, elevation in storeys}

    def level_of(each: MapFeature) -> str:
        z = each.keys.get("floor", 0.0 if each.pose is None else each.pose.z) + STANDS
        below = [name for name, elevation in storeys if elevation <= z]
        return str(each.keys.get("storey", (below or [storeys[0][0]])[-1]))

    def on(name: str, *layers: str) -> list[MapFeature]:
        return [each for each in found.all(*layers) if level_of(each) == name]

    at: dict[str, tuple[str, int]] = {}
    for name, level in levels.items():
        _add_rooms(level, on(name, "rooms"), on(name, "doors"))
        at |= {each: (name, n) for each, n in _add_places(level, on(name, "regions")).items()}
        for thing in on(name, "objects"):
            _add_model(level, thing)
    for start, end, about in found.lanes:
        (here, a), (there, b) = at.get(start, ("", 0)), at.get(end, ("", 0))
        if here and here == there:
            common = {"bidirectional": bool(about.get("bidirectional", True))}
            common |= {key: about[key] for key in LANE_PROPERTIES if key in about}
            for graph in about.get("graphs", [0]):
                lane = [a, b, _params({**common, "graph_idx": graph})]
                levels[here].data["lanes"].append(lane)
    return {
        "name": found.name,
        "coordinate_system": "cartesian_meters",
        "reference_level_name": storeys[0][0],
        "levels": {name: level.data for name, level in levels.items()},
        "lifts": _lifts(found, [name for name, _ in storeys]),
    }


def _add_rooms(level: _Level, rooms: list[MapFeature], doors: list[MapFeature]) -> None:
    outlines: dict[str, Polygon | MultiPolygon] = {
        each.name: each.geometry
        for each in rooms
        if each.geometry is not None and each.geometry.area > 0 and "elevator" not in each.keys
    }
    inside = united(outlines.values())
    parts: dict[str, list[Polygon]] = {name: [] for name in outlines}
    lines: dict[str, Any] = {each.name: each.geometry for each in doors if _is_passage(each)}
    for door in (each for each in doors if each.name in lines):
        for side in (REACH, -REACH):
            beyond = lines[door.name].buffer(-side, single_sided=True)
            way = without(lines[door.name].buffer(side, single_sided=True), inside)
            for part in polygons(way):
                room = _beside(part, door, outlines)
                if room is not None:
                    grown = part.buffer(10 * GRID, join_style="mitre")  # into the room, to be sure
                    parts[room] += polygons(without(grown, beyond))
    gaps = shapely.union_all([line.buffer(10 * GRID, cap_style="flat") for line in lines.values()])
    for name, outline in outlines.items():
        area = shapely.union_all([outline, *parts[name]], grid_size=GRID)
        for part in polygons(area):
            corners = [level.vertex(*point) for point in part.exterior.coords[:-1]]
            level.data["floors"].append({"parameters": _params(FLOOR), "vertices": corners})
        for side in shapely.get_parts(shapely.line_merge(area.boundary.difference(gaps))):
            for ends in pairwise(side.coords):
                level.edge("walls", ends, WALL)
        middle = middle_of(area)
        level.vertex(middle.x, middle.y, name, **{NAMES_ROOM: True})
    for door in doors:
        if door.name in lines and OPENING not in supertypes(door.keys.get("type", "door")):
            level.edge("doors", lines[door.name].coords, _door(door))


def _is_passage(door: MapFeature) -> bool:
    above = supertypes(door.keys.get("type", "door"))
    return door.geometry is not None and not above & {"elevator_door", "stairs", "ramp"}


def _beside(
    part: Polygon, door: MapFeature, areas: Mapping[str, Polygon | MultiPolygon]
) -> str | None:
    """The room of a door whose border a piece of the doorway shares, beside the door's line."""
    near = part.buffer(10 * GRID)
    if not near.intersects(door.geometry):
        return None
    rooms = [room for room in door.places if room in areas]
    shared = {room: common(near, areas[room]).area for room in rooms}
    best = max(shared, key=lambda room: shared[room], default=None)
    return best if best is not None and shared[best] > 0 else None


def _door(door: MapFeature) -> dict[str, Any]:
    above = supertypes(door.keys.get("type", "door"))
    kind = next((given for type_, given in DOOR_TYPES.items() if type_ in above), "hinged")
    own = {k: v for k, v in door.free.items() if k in HINGES}
    return {"name": door.name, "type": str(door.free.get("door_type", kind)), **HINGES, **own}


def _add_places(level: _Level, regions: list[MapFeature]) -> dict[str, int]:
    """Add the regions that are points; return the numbers of their vertices by name."""
    numbers = {}
    kinds = {type_: key for key, type_ in PLACE_TYPES}
    for each in regions:
        if each.geometry is not None and each.geometry.geom_type == "Point":
            params = {k: v for k, v in each.free.items() if type(v) in TYPES}
            key = kinds.get(each.keys.get("type", ""))
            if key is not None and not params.get(key):
                params[key] = (
                    each.name if key.endswith(("_name", "dispenser", "ingestor")) else True
                )
            name = each.keys.get("label", each.name)
            numbers[each.name] = level.vertex(each.geometry.x, each.geometry.y, name, **params)
    return numbers


def _add_model(level: _Level, thing: MapFeature) -> None:
    if thing.pose is None or thing.keys["kind"] != "object" or thing.keys.get("type") in PARTS:
        return
    x, y, z = (round(float(v), 4) for v in thing.pose[:3])
    model = str(thing.free.get("model") or thing.keys.get("type") or "object")
    level.data["models"].append(
        {
            "model_name": model,
            "name": thing.name,
            "static": thing.free.get("static") is not False,
            "x": x,
            "y": y,
            "yaw": round(thing.pose.yaw, 6),
            "z": round(z - level.data["elevation"], 4),
        }
    )


def _lifts(found: MapFeatures, storeys: list[str]) -> dict[str, Any]:
    """The elevators whose cabins have an outline, with their doors on each level."""
    lifts: dict[str, Any] = {}
    for elevator in found.all("elevators"):
        cabins = {
            each.name: each
            for each in found.all("rooms")
            if each.keys.get("elevator") == elevator.name
        }
        served = [s for s in storeys if any(c.keys.get("storey", s) == s for c in cabins.values())]
        first = next(iter(cabins.values()), None)
        if first is None or first.geometry is None or first.geometry.area == 0:
            continue
        frame, width, depth = _cabin(first.geometry, first.keys.get("heading", 0.0))
        doors: dict[str, dict[str, Any]] = {}
        stops: dict[str, list[str]] = {name: [] for name in served}
        for door in found.all("doors"):
            if not {*door.places} & cabins.keys() or door.geometry is None:
                continue
            about = _lift_door(door.geometry, frame)
            same = (name for name, given in doors.items() if given == about)
            name = next(same, f"door{len(doors) + 1}")
            doors[name] = about
            stop = door.keys.get("storey", storeys[0])
            if stop in stops and name not in stops[stop]:
                stops[stop].append(name)
        lifts[elevator.name] = {
            "x": round(frame.x, 4),
            "y": round(frame.y, 4),
            "yaw": round(frame.yaw, 6),
            "width": round(width, 4),
            "depth": round(depth, 4),
            "reference_floor_name": storeys[0],
            "initial_floor_name": str(elevator.free.get("initial_level", served[0])),
            "lowest_floor": served[0],
            "highest_floor": served[-1],
            "plugins": True,
            "doors": doors,
            "level_doors": stops,
        }
    return lifts


def _cabin(outline: shapely.Geometry, heading: float) -> tuple[Pose, float, float]:
    """The frame, width (along x) and depth of the rectangle around a cabin.

    It is turned as the cabin's frame, or as its outline where that leaves corners free.
    """
    edge = np.diff(shapely.get_coordinates(shapely.oriented_envelope(outline))[:2], axis=0)[0]
    for yaw in (heading, float(np.arctan2(edge[1], edge[0]))):
        frame = Pose.planar(0.0, 0.0, yaw)
        own = frame.inverse().apply(np.pad(shapely.get_coordinates(outline), ((0, 0), (0, 1))))
        low, high = own.min(axis=0), own.max(axis=0)
        width, depth, _ = (high - low).tolist()
        if outline.area >= 0.99 * width * depth:
            break
    x, y, _ = frame.apply([(low + high) / 2])[0].tolist()
    return Pose.planar(x, y, yaw), width, depth


def _lift_door(line: LineString, frame: Pose) -> dict[str, Any]:
    """A door of a cabin, in the cabin's frame."""
    (ax, ay, _), (bx, by, _) = frame.inverse().apply([(*p[:2], 0.0) for p in line.coords]).tolist()
    along = float(np.arctan2(by - ay, bx - ax))
    return {
        "door_type": 2,
        "motion_axis_orientation": round(along % np.pi, 4),
        "width": round(float(np.hypot(bx - ax, by - ay)), 3),
        "x": round((ax + bx) / 2, 3) + 0.0,
        "y": round((ay + by) / 2, 3) + 0.0,
    }
