"""Rooms merged, split and redrawn: doors, and what rooms hold, follow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import shapely
from shapely.geometry.base import BaseGeometry
from shapely.ops import split

from semmap.api.additions import CLEARANCE, add_entry, door, drawn
from semmap.geometry.morphology import polygons
from semmap.geometry.overlay import common, united
from semmap.query.map_check.building import WALL

if TYPE_CHECKING:
    from semmap.api.map import Map
    from semmap.api.map_entity import MapEntity

GAP = WALL + 0.1
"""Metres between the outlines of two rooms that becomes floor: those that are found keep off walls
by a cell."""


def redraw(room: MapEntity, outline: Any) -> None:
    """Give a room another outline, in the map's frame, metres; holders follow."""
    room.map._write(
        "UPDATE gis_room SET geom = ST_Multi(ST_GeomFromWKB(%s)) WHERE fid = %s",
        shapely.to_wkb(shapely.force_2d(outline)),
        room.id,
    )


def merge(map: Map, rooms: Sequence[MapEntity]) -> None:
    """Make some rooms one, the first of them; the strips of walls between them become floor."""
    first, *others = rooms
    ids, storeys = [room.id for room in others], {room.storey for room in rooms}
    if len({first.id, *ids}) != len(rooms) or not others:
        raise ValueError("name two rooms or more, each once")
    if len(storeys) > 1:
        raise ValueError(f"{first.name} and the others are not on one storey")
    whole = first.footprint
    for room in others:
        part = room.footprint
        if whole is None or part is None or whole.distance(part) > WALL:
            raise ValueError(f"{room.name} does not lie beside {first.name}, at most {WALL} m off")
        whole = joined(whole, part)
    map._write(
        "DELETE FROM entity WHERE id IN (SELECT entity_id FROM connector "
        "WHERE place_a <> place_b AND place_a = ANY (%s) AND place_b = ANY (%s))",
        [first.id, *ids],
        [first.id, *ids],
    )
    for place in ("place_a", "place_b"):
        map._write(f"UPDATE connector SET {place} = %s WHERE {place} = ANY (%s)", first.id, ids)
    redraw(first, whole)
    map._write(
        "SELECT put(entity_id, %s, relation, confidence) FROM placement WHERE holder_id = ANY (%s)",
        first.id,
        ids,
    )
    for room in others:
        room.delete()


def joined(first: BaseGeometry, second: BaseGeometry) -> shapely.MultiPolygon:
    """Return the outlines of two rooms that lie side by side as one, with the strip between."""
    both = united([first, second])
    strip = both.buffer(GAP / 2, join_style="mitre").buffer(-GAP / 2, join_style="mitre")
    for each in (first, second):
        strip = united(polygons(common(strip, each.buffer(GAP))))  # without lines where they touch
    return shapely.multipolygons(polygons(united([both, strip]).simplify(1e-6)))


def cut(map: Map, room: MapEntity, line: Any, name: str) -> MapEntity:
    """Split a room by a line into itself and a new room; an opening joins them."""
    whole = room.footprint
    if room.kind != "room" or whole is None:
        raise ValueError(f"{room.name} is no room with an outline")
    way = shapely.LineString(line)
    parts = [*split(shapely.get_parts(whole)[0], way).geoms] if way.is_simple else []
    if len(parts) != 2 or len(shapely.get_parts(whole)) > 1:
        raise ValueError(
            f"the line does not cut {room.name} in two: draw it from wall to wall, and beyond"
        )
    rest, new = sorted(parts, key=lambda part: -part.area)
    common = shapely.get_parts(rest.intersection(new))  # the line may run along walls, too
    borders = shapely.line_merge(shapely.union_all(common[shapely.length(common) > 0]))
    border = max(shapely.get_parts(borders), key=shapely.length)
    opening = shapely.get_coordinates(border)[[0, -1]].tolist()
    row = map._rows(
        "SELECT w.pose[3] + r.floor, w.pose[3] + r.ceiling FROM room r JOIN world w "
        "ON w.entity_id = r.entity_id WHERE r.entity_id = %s",
        room.id,
    )
    floor, ceiling = row[0]
    redraw(room, rest)
    storey = room.storey
    made = drawn(name, "room", new, floor, ceiling, room.type, None)
    added = add_entry(map, made, storey=storey.name if storey else None)
    for place, end in (("place_a", "ST_StartPoint"), ("place_b", "ST_EndPoint")):
        map._write(
            f"UPDATE connector SET {place} = %s FROM gis_connector g WHERE fid = entity_id "
            f"AND connector.{place} = %s AND ST_Distance({end}(g.geom), ST_GeomFromWKB(%s)) "
            f"< ST_Distance({end}(g.geom), ST_GeomFromWKB(%s))",
            added.id,
            room.id,
            shapely.to_wkb(new),
            shapely.to_wkb(rest),
        )
    detail = {"width": None, "type": "door", "behaviour": "drive_through"}
    between = door(
        map, f"{room.name}-{name}", (room.name, name), opening, floor, CLEARANCE, **detail
    )
    between.type = "opening"
    add_entry(map, between)
    return added
