"""What a map feature says: its type and kind, words and numbers, areas and lines."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import cast

import shapely
from shapely import LineString, MultiPolygon, Point, Polygon

from semmap.ingest.annotation.feature_file import Feature
from semmap.ingest.ontology.tbox import KINDS, TypeRecord, read_tbox, snake_case
from semmap.ingest.world import Kind, Refused

__all__ = [
    "area_of",
    "choice",
    "drawn_as",
    "flag_of",
    "heading_of",
    "kind_of",
    "line_of",
    "middle_of",
    "number",
    "supertypes",
    "text",
    "type_of",
]

SMALLEST = 1e-4
"""A polygon of less area, in m2, is a slip of the mouse."""

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


# -- the T-Box ------------------------------------------------------------------------------


@functools.cache
def _tbox() -> Mapping[str, TypeRecord]:
    from semmap.database.files import schema_folder

    files = sorted((schema_folder() / "ontology").glob("*.ttl"))
    return {record.name: record for record in read_tbox(files)}


@functools.cache
def _type_of_word() -> Mapping[str, str]:
    """Names of types and their synonyms; a word that is a name means the type of that name."""
    words = {snake_case(word): r.name for r in _tbox().values() for word in r.synonyms}
    return words | {name: name for name in _tbox()}


def supertypes(type_: str) -> set[str]:
    """A type and all that subsume it; for one that the T-Box lacks, itself."""
    above, todo = set(), [type_]
    while todo:
        above.add(current := todo.pop())
        todo += _tbox()[current].parents if current in _tbox() else ()
    return above


# -- words and numbers -----------------------------------------------------------------------


def text(feature: Feature, key: str) -> str | None:
    """A property as text; None where it is absent or empty."""
    value = feature.properties.get(key)
    if value is None or value == "":
        return None
    if isinstance(value, bool | list | dict):
        raise Refused(f"its {key} is {value!r}", f"Give {key} as text.")
    return str(value).strip()


def number(feature: Feature, key: str) -> float | None:
    """A property as a finite number."""
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


def choice(feature: Feature, key: str, choices: tuple[str, ...], default: str) -> str:
    """A property that is one of a few words."""
    value = text(feature, key) or default
    if value not in choices:
        raise Refused(f"its {key} is {value!r}", f"Use one of {', '.join(choices)}.")
    return value


def flag_of(value: object, key: str) -> bool:
    """A value as true or false."""
    flags = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
    found = flags.get(str(value).strip().lower())
    if found is None:
        raise Refused(f"its {key} is {value!r}", f"Give {key} as true or false.")
    return found


def heading_of(feature: Feature) -> float:
    """Counter-clockwise from +x, radians."""
    degrees = number(feature, "heading_deg")
    return math.radians(degrees) if degrees is not None else number(feature, "heading") or 0.0


def type_of(feature: Feature) -> str | None:
    """The type that a feature says, by its name in the T-Box where that has the word."""
    said = text(feature, "type")
    kind = snake_case(text(feature, "kind") or "")
    if said is None:
        return kind if kind in _tbox() and kind not in KINDS else None
    name = snake_case(said)
    if not name:
        raise Refused(f"its type is {said!r}", "Give a type such as dining_table.")
    return _type_of_word().get(name, name)


def kind_of(feature: Feature, type_: str | None) -> Kind:
    """The kind of entity: as said, else that of the layer, else that of the type."""
    said = text(feature, "kind")
    if said is not None:
        known = _tbox().get(snake_case(said))
        kind = known.kind if known else LAYERS.get(said.lower())
        if kind is None:
            raise Refused(f"its kind is {said!r}", f"Use one of {', '.join(KINDS)}.")
        return cast(Kind, kind)
    kind = LAYERS.get((feature.layer or "").lower())
    if kind is None and type_ is not None and type_ in _tbox():
        kind = cast("Kind | None", _tbox()[type_].kind)
    if kind is None:
        raise Refused(
            "it says no kind, its layer is none that is known, and its type is not in the T-Box",
            f"Add the property kind: {', '.join(KINDS)}.",
        )
    return kind


# -- areas and lines -------------------------------------------------------------------------


def area_of(feature: Feature, notes: list[str]) -> Polygon | MultiPolygon:
    """The feature's area, repaired where that leaves it one area."""
    geometry = feature.geometry
    assert isinstance(geometry, Polygon | MultiPolygon)
    if not geometry.is_valid:
        reason = shapely.is_valid_reason(geometry)
        parts = shapely.get_parts(shapely.make_valid(geometry))
        areas = [p for part in parts for p in shapely.get_parts(part) if p.area > SMALLEST]
        areas = [p for p in areas if isinstance(p, Polygon)]
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


def middle_of(area: Polygon | MultiPolygon) -> Point:
    """A point of the area, its centroid where that lies in it."""
    return area.centroid if area.contains(area.centroid) else area.representative_point()


def line_of(feature: Feature, notes: list[str]) -> LineString:
    """The straight line of a connector, from its first to its last point."""
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
        notes.append(f"{feature.where}: its line is taken as straight from end to end")
    return line


def drawn_as(feature: Feature) -> str:
    return feature.geometry.geom_type if feature.geometry is not None else "nothing"
