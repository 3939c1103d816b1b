"""The values of a map feature: its type and kind, texts and numbers, areas and lines."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from datetime import datetime
from typing import cast

import shapely
from shapely import LineString, MultiPolygon, Point, Polygon

from semmap.geometry.morphology import areas_within
from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.annotation.feature_file import Feature
from semmap.ingest.ontology.tbox import KINDS, TypeRecord, own_tbox
from semmap.ingest.world import Kind, Refused
from semmap.snake_case import snake_case

SMALLEST = 1e-4
"""Least area of a polygon, m2; a smaller one is an accidental click."""

LAYERS: dict[str, Kind] = {
    "rooms": "room",
    "places": "room",
    "doors": "connector",
    "connectors": "connector",
    "elevators": "elevator",
    "lifts": "elevator",
    "storeys": "storey",
    "levels": "storey",
    "regions": "region",
    "zones": "region",
    "objects": "object",
    "furniture": "object",
    "agents": "agent",
    "robots": "agent",
}
"""The kind of the features in a layer of this name."""


@functools.cache
def _tbox() -> Mapping[str, TypeRecord]:
    return {record.name: record for record in own_tbox()}


@functools.cache
def _type_of_word() -> Mapping[str, str]:
    """Return the type of each name and synonym; a name takes precedence over a synonym."""
    words = {snake_case(word): r.name for r in _tbox().values() for word in r.synonyms}
    return words | {name: name for name in _tbox()}


def supertypes(type_: str) -> set[str]:
    """Return a type and all its supertypes; a type that the T-Box lacks has only itself."""
    above, todo = set(), [type_]
    while todo:
        above.add(current := todo.pop())
        todo += _tbox()[current].parents if current in _tbox() else ()
    return above


def text(feature: Feature, key: str) -> str | None:
    """Return a property as text; None where it is absent or blank."""
    value = feature.properties.get(key)
    if value is None:
        return None
    if isinstance(value, bool | list | dict):
        raise Refused(f"its {key} is {value!r}", f"Give {key} as text.")
    return str(value).strip() or None


def number(feature: Feature, key: str) -> float | None:
    """Return a property as a finite number; None where it is absent or empty."""
    value = feature.properties.get(key)
    if value is None or value == "":
        return None
    try:
        if isinstance(value, bool):
            raise ValueError
        number = float(value)
        if not abs(number) <= 1e6:
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        raise Refused(f"its {key} is {str(value)[:40]!r}", f"Give {key} as a number.") from None
    return number


def time_of(feature: Feature, key: str) -> datetime | None:
    """Return a property as an aware time, local without a zone; None where it is absent."""
    value = feature.properties.get(key)
    if value is None or value == "":
        return None
    try:
        return datetime.fromisoformat(str(value)).astimezone()
    except (ValueError, OverflowError):
        fix = f"Give {key} as 2026-01-31T12:00Z."
        raise Refused(f"its {key} is {str(value)[:40]!r}", fix) from None


def choice(feature: Feature, key: str, choices: tuple[str, ...], default: str) -> str:
    """Return a property that is one of a few words."""
    value = text(feature, key) or default
    if value not in choices:
        raise Refused(f"its {key} is {value!r}", f"Use one of {', '.join(choices)}.")
    return value


def flag_of(value: object, key: str) -> bool:
    """Return a value as true or false."""
    flags = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
    found = flags.get(str(value).strip().lower())
    if found is None:
        raise Refused(f"its {key} is {value!r}", f"Give {key} as true or false.")
    return found


def heading_of(feature: Feature) -> float:
    """Return the heading of a feature, counter-clockwise from +x, radians."""
    degrees = number(feature, "heading_deg")
    return math.radians(degrees) if degrees is not None else number(feature, "heading") or 0.0


def pose_of(feature: Feature) -> Pose:
    """Return the property `pose` of a feature: seven numbers, the last four a quaternion."""
    given = feature.properties.get("pose")
    if given is None:
        return IDENTITY
    try:
        numbers = [float(each) for each in given]
        length = math.hypot(*numbers[3:])
        if len(numbers) != 7 or length < 1e-9 or not max(map(abs, numbers)) <= 1e6:
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        fix = "Give x, y, z in metres and a quaternion qx, qy, qz, qw."
        raise Refused(f"its pose is {str(given)[:60]!r}", fix) from None
    return Pose(*numbers[:3], *(each / length for each in numbers[3:]))


def type_of(feature: Feature) -> str | None:
    """Return the type of a feature, by its name in the T-Box where that has the word."""
    given = text(feature, "type")
    kind = snake_case(text(feature, "kind") or "")
    if given is None:
        return kind if kind in _tbox() and kind not in KINDS else None
    name = snake_case(given)
    if not name:
        raise Refused(f"its type is {given!r}", "Give a type such as dining_table.")
    return _type_of_word().get(name, name)


def kind_of(feature: Feature, type_: str | None) -> Kind:
    """Return the kind of entity: the property, else that of the layer, else that of the type."""
    given = text(feature, "kind")
    if given is not None:
        known = _tbox().get(snake_case(given))
        kind = known.kind if known else LAYERS.get(given.lower())
        if kind is None:
            raise Refused(f"its kind is {given!r}", f"Use one of {', '.join(KINDS)}.")
        return cast(Kind, kind)
    kind = LAYERS.get((feature.layer or "").lower())
    if kind is None and type_ is not None and type_ in _tbox():
        kind = cast("Kind | None", _tbox()[type_].kind)
    if kind is None:
        raise Refused(
            "it names no kind, its layer is unknown, and its type is not in the T-Box",
            f"Add the property kind: {', '.join(KINDS)}.",
        )
    return kind


def area_of(feature: Feature, notes: list[str]) -> Polygon | MultiPolygon:
    """Return the feature's area, repaired where that leaves one area."""
    geometry = feature.geometry
    assert isinstance(geometry, Polygon | MultiPolygon)
    if not geometry.is_valid:
        reason = shapely.is_valid_reason(geometry)
        areas = areas_within(geometry, SMALLEST)
        if len(areas) > 1:
            raise Refused(
                f"its outline crosses itself ({reason}) and falls into {len(areas)} areas",
                "Draw it again.",
            )
        if areas:
            notes.append(f"{feature.where}: the outline is repaired ({reason})")
        geometry = areas[0] if areas else Polygon()
    if geometry.area <= SMALLEST:
        raise Refused("its outline has no area", "Draw it again.")
    if isinstance(geometry, MultiPolygon) and len(geometry.geoms) == 1:
        return geometry.geoms[0]
    return geometry


def line_of(feature: Feature, notes: list[str]) -> LineString:
    """Return the straight line of a connector, from its first to its last point."""
    geometry = feature.geometry
    if geometry is not None and geometry.geom_type == "MultiLineString":
        geometry = shapely.line_merge(geometry)
    if isinstance(geometry, Point):
        width = number(feature, "width")
        if width is None or not {"heading", "heading_deg"} & feature.properties.keys():
            raise Refused("is a point without width and heading", "Draw the line of its opening.")
        across = heading_of(feature) - math.pi / 2
        dx, dy = width / 2 * math.cos(across), width / 2 * math.sin(across)
        geometry = LineString(
            [(geometry.x + dx, geometry.y + dy), (geometry.x - dx, geometry.y - dy)]
        )
    if not isinstance(geometry, LineString):
        raise Refused(f"is drawn as {drawn_as(feature)}", "Draw the line of its opening.")
    points = shapely.get_coordinates(geometry)
    line = LineString(points[[0, -1]])
    if line.length < 0.01:
        raise Refused(
            "its line has no length", "Draw it from one side of the opening to the other."
        )
    if geometry.length > 1.01 * line.length:
        notes.append(f"{feature.where}: its line is read as straight from end to end")
    return line


def drawn_as(feature: Feature) -> str:
    """Return the type of a feature's geometry, for messages."""
    return feature.geometry.geom_type if feature.geometry is not None else "nothing"
