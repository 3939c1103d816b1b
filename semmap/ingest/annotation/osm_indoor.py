"""OpenStreetMap's Simple Indoor Tagging, as GeoJSON (https://wiki.openstreetmap.org/wiki/Simple_Indoor_Tagging).

``indoor=room|area|corridor`` are rooms, ``indoor=door`` and nodes with `door` are doors in their
borders, ``indoor=wall`` are walls; ``level=0;1`` or ``0-2``, and `repeat_on`, put one of each on
each level. Areas and corridors are open to each other. Stairs, drawn as areas or lines, and ramps,
drawn as lines, join the levels that they have; elevators have a cabin on each.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from shapely import LineString, MultiPolygon, Point, Polygon

from semmap.geometry.morphology import polygons
from semmap.geometry.overlay import common, united, without
from semmap.ingest.annotation.feature_file import Feature, FeatureFile
from semmap.ingest.annotation.level_ways import leads_into, way_along, way_feature
from semmap.ingest.floor_plan import open_borders, straight_parts
from semmap.ingest.naming import guess_type
from semmap.ingest.storeys import ASSUMED_HEIGHT
from semmap.ingest.world import Refused

OPEN = ("area", "corridor")
ROOMS = ("room", *OPEN)

STAIRS, ELEVATOR = ("stairs", "steps"), ("elevator",)
"""Values of `room` and `highway`, and keys with the value yes, of what joins levels."""

WIDTH, THICKNESS = 0.9, 0.1
"""Metres of a door that is a node, and of a wall that is a line."""

CABIN, LARGER = 1.6, 3.0
"""Metres of the sides of a lift's cabin, where the lift is a node; and how many times as large the
room that it is in must be."""

NEAR = 1.0
"""Metres from a room within which a way ends there."""

ROOM_TYPES = {
    "cafe": "cafeteria",
    "class": "classroom",
    "conference": "meeting_room",
    "laundry": "laundry_room",
    "lockers": "changing_room",
    "changing": "changing_room",
    "surgery": "operating_theatre",
    "technical": "utility_room",
    "toilet": "restroom",
    "toilets": "restroom",
    "waiting": "waiting_room",
}
"""The types of rooms by values of `room` and `amenity` that are no names of types."""

NO_ACCESS, PRIVATE = ("private", "no"), "private"
"""Values of `access` of doors that are not for everybody, and the permission that they need."""

MOST_LEVELS = 200

_FEET = re.compile(r"(?=.)(?:(\d+(?:\.\d+)?)')?\s*(?:(\d+(?:\.\d+)?)\")?")
"""Feet and inches: ``2'11"``, ``3'`` and ``36"``."""

_LEVEL = re.compile(r"(-?\d+(?:\.\d+)?)(?:-(-?\d+(?:\.\d+)?))?")


@dataclass(frozen=True)
class _Room:
    """A room on a level: its name, its area in metres, and what it is."""

    name: str
    area: Polygon | MultiPolygon
    is_open: bool
    is_cabin: bool


def is_osm_indoor(features: Sequence[Feature]) -> bool:
    """Return whether features have indoor tags, and not the keys of annotations."""
    tags = [feature.properties for feature in features]
    return any("indoor" in each for each in tags) and not any("kind" in each for each in tags)


def from_osm_indoor(file: FeatureFile) -> FeatureFile:
    """Return the features of a file, in metres, with the keys of annotations."""
    drawn, file.features = file.features, []
    left = 0
    on_levels: list[tuple[Feature, list[float]]] = []
    for each in drawn:
        with file.leaving_out(each.where, each.properties.get("name")):
            on_levels.append((each, _levels(each)))
    on_levels, shafts = _with_cabins(file, on_levels)
    names = {level: f"level {level:g}" for _, levels in on_levels for level in levels}
    for level in sorted(names):
        about = {"kind": "storey", "name": names[level], "elevation": level * ASSUMED_HEIGHT}
        file.features.append(Feature("level", None, None, about))
    rooms: dict[float, list[_Room]] = {level: [] for level in names}
    walls: dict[float, list[LineString]] = {level: [] for level in names}
    taken: set[str] = set()
    for each, levels in on_levels:
        if _is_room(each):
            height = _ceiling(each, file.notes)
            file.features += _rooms(each, levels, names, rooms, taken, shafts, height)
        elif each.properties.get("indoor") == "wall" and isinstance(each.geometry, LineString):
            for level in levels:
                walls[level].append(each.geometry)
    borders: dict[float, list[LineString]] = {}
    for level, storey in names.items():
        areas = [part for room in rooms[level] for part in polygons(room.area)]
        borders[level] = [side for area in areas for side in straight_parts(area.exterior)]
        file.features += _openings(rooms[level], walls[level], storey)
    for each, levels in on_levels:
        tags = each.properties
        if _is_room(each) or tags.get("indoor") == "level":
            continue
        if len(levels) > 1 and isinstance(each.geometry, LineString) and "highway" in tags:
            for pair in itertools.pairwise(levels):
                with file.leaving_out(each.where, tags.get("name")):
                    file.features.append(_way(each, pair, names, rooms))
            continue
        door = tags.get("indoor") == "door" or {"door", "entrance"} & tags.keys()
        if not door and tags.get("indoor") != "wall":
            left += 1
            continue
        for level in levels:
            with file.leaving_out(each.where, tags.get("name")):
                made = _door(each, rooms[level], borders[level]) if door else _wall(each)
                own = dict(made.properties, storey=names[level])
                if len(levels) > 1:
                    own.pop("name", None)
                file.features.append(replace(made, properties=own))
    file.notes.append(f"levels have no heights: each is {ASSUMED_HEIGHT:g} m high")
    if left:
        file.notes.append(f"{left} features without indoor tags are left out")
    return file


def _levels(feature: Feature) -> list[float]:
    """Return the levels of a feature, lowest first; 0 where it has none."""
    found: set[float] = set()
    tags = feature.properties
    stated = [str(tags[key]) for key in ("level", "repeat_on") if tags.get(key) is not None]
    for part in re.split("[;,]", ";".join(stated or ["0"])):
        match = _LEVEL.fullmatch(part.strip())
        first, last = (float(v) for v in (match[1], match[2] or match[1])) if match else (1.0, 0.0)
        if not first <= last <= first + MOST_LEVELS or abs(first) > MOST_LEVELS:
            problem = f"its level is {';'.join(stated)[:40]!r}"
            raise Refused(problem, "Write it as 0, 0;1 or 0-2.")
        found |= {first + step for step in range(int(last - first) + 1)}
    return sorted(found)


def _with_cabins(
    file: FeatureFile, on_levels: list[tuple[Feature, list[float]]]
) -> tuple[list[tuple[Feature, list[float]]], dict[float, Any]]:
    """Give each lift that is a node a cabin, and a door to a room on each level.

    Returns the features and their levels, and by level the area of these cabins.
    """
    drawn = [(each.geometry, levels) for each, levels in on_levels if _is_room(each)]
    rooms = [(room, levels) for room, levels in drawn if shapely.is_valid(room)]
    found, shafts = [], {level: Point() for _, levels in on_levels for level in levels}
    for each, levels in on_levels:
        if not _is_lift_node(each):
            found.append((each, levels))
            continue
        cabin: Any = shapely.buffer(each.geometry, CABIN / 2, cap_style="square")
        with file.leaving_out(each.where, each.properties.get("name")):
            beside = {
                n: [r for r, on in rooms if n in on and shapely.intersects(r, cabin)]
                for n in levels
            }
            stops = [n for n in levels if beside[n]]
            if not stops:
                fault = "is a lift beside no room of its levels"
                raise Refused(fault, "Draw the rooms, or its cabin.")
            if missed := [f"{n:g}" for n in levels if n not in stops]:
                text = f"{each.where} is a lift beside no room of level {', '.join(missed)}"
                file.notes.append(f"{text}: it does not stop there")
            doors = [_cabin_door(cabin, beside[level]) for level in stops]
            found.append((replace(each, geometry=cabin), stops))
            for level, door in zip(stops, doors, strict=True):
                found.append((Feature(each.where, None, door, {"door": "yes"}), [level]))
                shafts[level] = united([shafts[level], cabin])
            file.notes.append(f"{each.where} is a node: its cabin is assumed {CABIN:g} m wide")
    return found, shafts


def _is_lift_node(feature: Feature) -> bool:
    return isinstance(feature.geometry, Point) and _joins(feature, ELEVATOR)


def _cabin_door(cabin: Polygon, rooms: list[Any]) -> Point:
    """The middle of the side of a cabin before which most of the nearest room is."""
    room = min(rooms, key=cabin.centroid.distance)
    if room.area < LARGER * cabin.area:
        raise Refused("is a lift in a room of its size", "Give this room highway=elevator instead.")
    sides = [side.interpolate(0.5, normalized=True) for side in straight_parts(cabin.exterior)]
    return max(sides, key=lambda side: common(side.buffer(NEAR), without(room, cabin)).area)


def _is_room(feature: Feature) -> bool:
    drawn = isinstance(feature.geometry, Polygon | MultiPolygon)
    return drawn and (
        feature.properties.get("indoor") in ROOMS or _joins(feature, (*STAIRS, *ELEVATOR))
    )


def _joins(feature: Feature, words: tuple[str, ...]) -> bool:
    """Return whether a feature is one of the things that join levels."""
    tags = feature.properties
    return any(tags.get(key) in words for key in ("room", "highway", "stairwell", "indoor")) or any(
        tags.get(word) == "yes" for word in words
    )


def _rooms(
    feature: Feature,
    levels: list[float],
    names: dict[float, str],
    rooms: dict[float, list[_Room]],
    taken: set[str],
    shafts: dict[float, Any],
    height: dict[str, float],
) -> Iterator[Feature]:
    """Yield a room of a height for each level, which joins `rooms`, and stairs between them."""
    tags = feature.properties
    stairs, elevator = _joins(feature, STAIRS), _joins(feature, ELEVATOR)
    kind = "stairwell" if stairs else "elevator_cabin" if elevator else tags.get("indoor")
    use = str(tags.get("room") or tags.get("amenity") or tags.get("shop"))
    guess = guess_type(use, "room")
    type_ = ROOM_TYPES.get(use) or (None if guess is None else guess.type)
    type_ = "corridor" if kind == "corridor" else type_
    given = str(tags.get("name") or tags.get("ref") or type_ or "room")
    is_open = tags.get("indoor") in OPEN
    for level in levels:
        wanted = given if len(levels) == 1 else f"{given} {level:g}"
        name = next(n for n in _numbered(wanted) if n not in taken)
        taken.add(name)
        area: Any = feature.geometry
        if not elevator and area.is_valid and area.intersects(shafts[level]):
            area = without(area, shafts[level])
        rooms[level].append(_Room(name, area, is_open, elevator))
        about: dict[str, Any] = {"kind": "room", "name": name, "storey": names[level]}
        about |= height | ({"type": type_} if type_ else {})
        about |= {"type": kind} if stairs or elevator else {}
        about |= {"elevator": f"{given} lift"} if elevator else {}
        yield replace(feature, geometry=area, properties=_free(feature) | about)
    if stairs:
        line, type_ = way_along(feature.geometry), _type_of_way(feature)
        for low, high in itertools.pairwise(levels):
            joins = rooms[low][-1].name, rooms[high][-1].name
            yield way_feature(feature.where, line, joins, names[low], type_)


def _ceiling(feature: Feature, notes: list[str]) -> dict[str, float]:
    """Return the ceiling above the floor that a room states; a shaft states the height of all."""
    if feature.properties.get("height") is None or _joins(feature, (*STAIRS, *ELEVATOR)):
        return {}
    try:
        return {"ceiling": _metres(feature, "height", ASSUMED_HEIGHT)}
    except Refused as refused:
        notes.append(f"{feature.where}: {refused.problem}: its ceiling is not known")
        return {}


def _type_of_way(feature: Feature) -> str:
    tags = feature.properties
    if not _joins(feature, STAIRS):
        return "ramp"
    return "escalator" if tags.get("conveying", "no") != "no" else "stairs"


def _way(
    feature: Feature,
    levels: tuple[float, float],
    names: dict[float, str],
    rooms: dict[float, list[_Room]],
) -> Feature:
    """Return the way of a line between two levels: upwards as drawn, unless `incline` is down."""
    tags = feature.properties
    line: Any = feature.geometry
    ends = [Point(line.coords[0]), Point(line.coords[-1])]
    down = str(tags.get("incline", "up")).startswith(("down", "-"))
    joins = []
    for level, end in zip(levels, reversed(ends) if down else ends, strict=True):
        near = min(rooms[level], key=lambda room: room.area.distance(end), default=None)
        if near is None or near.area.distance(end) > NEAR:
            problem = f"does not end in a room of {names[level]}"
            raise Refused(problem, "Draw the rooms that it joins.")
        joins.append(near.name)
    direction = {"forward": "forward", "backward": "backward"}.get(str(tags.get("conveying")))
    more: dict[str, Any] = _free(feature) | _named(feature)
    if direction is not None:
        more["direction"] = direction
    first, second = reversed(joins) if down else joins
    storey = names[levels[1] if down else levels[0]]
    return way_feature(feature.where, line, (first, second), storey, _type_of_way(feature), **more)


def _openings(rooms: list[_Room], walls: list[LineString], storey: str) -> Iterator[Feature]:
    """Yield an opening for each border of areas and corridors on which no wall stands."""
    free = [room for room in rooms if room.is_open and room.area.is_valid]
    areas = [(room.name, part) for room in free for part in polygons(room.area)]
    for opening in open_borders([part for _, part in areas], walls):
        a, b = (areas[number][0] for number in opening.rooms)
        line = max(straight_parts(opening.border), key=lambda part: part.length)
        about = {"kind": "connector", "type": "opening", "joins": [a, b], "storey": storey}
        if a != b:
            yield Feature(f"the border of {a} and {b}", None, line, about)


def _numbered(name: str) -> Iterator[str]:
    yield name
    yield from (f"{name} ({number})" for number in itertools.count(2))


def _door(feature: Feature, rooms: list[_Room], borders: list[LineString]) -> Feature:
    """Return a door; of a node, a line along the nearest border of a room."""
    geometry = feature.geometry
    if isinstance(geometry, Point):
        if not borders:
            raise Refused("is a door on a level without rooms", "Add the rooms.")
        border = borders[int(np.argmin(shapely.distance(borders, geometry)))]
        start, end = shapely.get_coordinates(border)
        along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
        at = np.array(border.interpolate(border.project(geometry)).coords[0])
        half = _metres(feature, "width", WIDTH) / 2
        geometry = LineString([at - half * along, at + half * along])
    if not isinstance(geometry, LineString):
        raise Refused(f"is a door drawn as {geometry and geometry.geom_type}", "Draw a node.")
    closed = "door" if feature.properties.get("door") != "no" else "opening"
    cabins = [room.area for room in rooms if room.is_cabin]
    about = {
        "kind": "connector",
        "type": "elevator_door" if leads_into(cabins, geometry) else closed,
    }
    about |= {"state": "locked"} if feature.properties.get("locked") == "yes" else {}
    about |= {"permissions": PRIVATE} if feature.properties.get("access") in NO_ACCESS else {}
    return replace(feature, geometry=geometry, properties=_free(feature) | about | _named(feature))


def _wall(feature: Feature) -> Feature:
    """Return a wall as the object that it is."""
    geometry = feature.geometry
    if isinstance(geometry, LineString):
        geometry = geometry.buffer(_metres(feature, "width", THICKNESS) / 2, cap_style="flat")
    about = {"kind": "object", "type": "wall", "height": _metres(feature, "height", ASSUMED_HEIGHT)}
    return replace(feature, geometry=geometry, properties=_free(feature) | about | _named(feature))


def _metres(feature: Feature, key: str, default: float) -> float:
    """Return a length of a tag, metres unless it names another unit."""
    given = str(feature.properties.get(key, default))
    if feet := _FEET.fullmatch(given):
        metres = 0.3048 * float(feet[1] or 0) + 0.0254 * float(feet[2] or 0)
    else:
        match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(m|cm)?", given)
        metres = 0.0 if match is None else float(match[1]) * (0.01 if match[2] == "cm" else 1.0)
    if not metres:
        raise Refused(f"its {key} is {feature.properties.get(key)!r}", "Give it in metres.")
    return metres


def _named(feature: Feature) -> dict[str, str]:
    given = feature.properties.get("name") or feature.properties.get("ref")
    return {"name": str(given)} if given else {}


def _free(feature: Feature) -> dict[str, Any]:
    """The tags as one free property: several have names that annotations use otherwise."""
    return {"osm": {k: v for k, v in feature.properties.items() if v is not None}}
