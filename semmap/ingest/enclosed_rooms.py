"""Rooms out of a floor plan drawn as lines: the faces that its walls and doors enclose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely import LineString, MultiLineString, Point, Polygon, STRtree
from shapely.ops import substring

__all__ = ["FloorPlan", "Opening", "Sides", "bridge_gaps", "enclose", "rooms_beside"]

GRID = 1e-4
"""Lines are noded on a grid of 0.1 mm, so that a line which ends on another really meets it."""

NARROWEST = 0.4
"""A face in which no disc of this diameter (metres) fits is a crack between lines, not a room."""

DOORWAY = 0.5
"""A border without wall or door is an opening from this length (metres) on."""


@dataclass(frozen=True)
class Opening:
    """Where two rooms meet with neither wall nor door between them: indices and the border."""

    rooms: tuple[int, int]
    border: LineString


@dataclass
class FloorPlan:
    """What the lines of one storey enclose.

    Attributes
    ----------
    rooms : polygons in metres, interiors disjoint, from top to bottom and left to right
    openings : borders between two rooms that can be walked through
    floorless : faces as large as a room that no floor covers: shafts, voids, courtyards
    cracks : faces too small or too thin to be rooms
    """

    rooms: list[Polygon] = field(default_factory=list)
    openings: list[Opening] = field(default_factory=list)
    floorless: list[Polygon] = field(default_factory=list)
    cracks: list[Polygon] = field(default_factory=list)


@dataclass(frozen=True)
class Sides:
    """The rooms to the left and to the right of a directed line; None where there is none."""

    left: int | None
    right: int | None


def bridge_gaps(
    lines: Sequence[LineString], gap: float, ends: Sequence[LineString] | None = None
) -> list[LineString]:
    """Short lines that close the gaps between the ends of lines and other lines.

    Parameters
    ----------
    lines : what an end may be joined to
    gap : the widest gap that is closed, metres; that width included
    ends : the lines whose ends are joined, `lines` where None

    Returns
    -------
    One line for each end and line that are further apart than 0 and at most `gap`.
    """
    tree = STRtree(lines)
    corners = shapely.points(
        np.unique(
            np.concatenate([shapely.get_coordinates(s)[[0, -1]] for s in ends or lines]), axis=0
        )
    )
    end, line = tree.query(corners, predicate="dwithin", distance=gap + 1e-6)
    bridges = shapely.shortest_line(corners[end], np.asarray(lines, dtype=object)[line])
    return [b for b in bridges if b.length > 0]


def enclose(
    walls: Sequence[LineString],
    doors: Sequence[LineString] = (),
    floors: Sequence[Polygon] = (),
    cabins: Sequence[Polygon] = (),
    cabin_doors: Sequence[LineString] = (),
    *,
    gap: float = 0.05,
    cabin_gap: float = 0.5,
    smallest: float = 0.5,
) -> FloorPlan:
    """Find the rooms of a storey.

    The lines of walls, doors and floor outlines are joined where they miss each other by at most
    `gap`, noded, and polygonised. A crack (between a wall and the floor outline drawn beside it,
    say) goes to the room that it is open to. Where there are floors, a face must lie on them.

    Parameters
    ----------
    walls, doors : straight lines, metres
    floors : their outlines close what walls leave open; a border that is nothing but an outline
        is an opening
    cabins : elevator cabins, cut out of the rooms
    cabin_doors : elevator doors, which stand in the opening of a shaft and are joined to what is
        within `cabin_gap` of their ends
    gap, cabin_gap : metres
    smallest : the area in square metres from which a face is a room
    """
    outlines = [line for floor in floors for line in _rings(floor)]
    drawn = [line for line in (*walls, *doors, *outlines, *cabin_doors) if line.length > 0]
    if not drawn:
        return FloorPlan()
    bridges = bridge_gaps(drawn, gap)
    if cabin_doors:
        bridges += bridge_gaps([*walls, *doors], cabin_gap, cabin_doors)
    noded = shapely.unary_union([*drawn, *bridges], grid_size=GRID)
    faces = list(shapely.polygonize([noded]).geoms)
    solid = shapely.unary_union([*walls, *doors, *cabin_doors, *bridges]).buffer(10 * GRID)

    faces, cracks = _fill_cracks(faces, solid, smallest)
    if cabins:
        rest = shapely.difference(faces, shapely.unary_union(cabins))
        parts = [p for face in rest for p in _polygons(face)]
        faces = [p for p in parts if _is_roomy(p, smallest)]
        cracks += [p for p in parts if not _is_roomy(p, smallest)]
    plan = FloorPlan(cracks=cracks)
    ground = shapely.unary_union(floors) if floors else None
    for face in sorted(faces, key=_reading_order):
        if ground is None or face.intersection(ground).area > face.area / 2:
            plan.rooms.append(face)
        else:
            plan.floorless.append(face)
    plan.openings = _openings(plan.rooms, solid)
    return plan


def rooms_beside(
    rooms: Sequence[Polygon], line: LineString, reach: float = 0.3, clearance: float = 0.05
) -> Sides:
    """The rooms on both sides of a door, judged by the strips along it.

    The strips leave out the outer tenths of the line and begin `clearance` beside it; of several
    rooms in a strip `reach` metres deep, the one that fills most of it counts.
    """
    tree = STRtree(rooms)
    middle = substring(line, 0.1, 0.9, normalized=True)

    def beside(sign: int) -> int | None:
        strip = shapely.difference(
            middle.buffer(sign * (clearance + reach), single_sided=True),
            middle.buffer(sign * clearance, single_sided=True),
        )
        near = [int(i) for i in tree.query(strip, predicate="intersects")]
        filled = {i: rooms[i].intersection(strip).area for i in near}
        best = max(filled, key=lambda i: (filled[i], -i), default=None)
        return best if best is not None and filled[best] > 0.1 * strip.area else None

    return Sides(beside(1), beside(-1))


def _rings(polygon: Polygon) -> list[LineString]:
    """The outline of a polygon, side by side."""
    sides = []
    for ring in (polygon.exterior, *polygon.interiors):
        corners = shapely.get_coordinates(ring)
        sides += [LineString(pair) for pair in zip(corners[:-1], corners[1:], strict=True)]
    return sides


def _polygons(geometry: shapely.Geometry) -> list[Polygon]:
    parts = shapely.get_parts(geometry)
    return [p for p in parts if isinstance(p, Polygon) and not p.is_empty]


def _is_roomy(face: Polygon, smallest: float) -> bool:
    return bool(face.area >= smallest and not face.buffer(-NARROWEST / 2).is_empty)


def _reading_order(face: Polygon) -> tuple[float, float]:
    """From top to bottom in rows of a decimetre, then left to right: the same at each import."""
    point: Point = face.centroid
    return (-round(point.y, 1), round(point.x, 1))


def _fill_cracks(
    faces: list[Polygon], solid: shapely.Geometry, smallest: float
) -> tuple[list[Polygon], list[Polygon]]:
    """Give each crack to the room with which it shares the longest border that is not solid."""
    rooms = [f for f in faces if _is_roomy(f, smallest)]
    cracks = [f for f in faces if not _is_roomy(f, smallest)]
    given = True
    while given and rooms and cracks:
        given = False
        tree = STRtree(rooms)
        left: list[Polygon] = []
        parts: dict[int, list[Polygon]] = {}
        for crack in cracks:
            beside = tree.query(crack, predicate="intersects")
            shared = {int(i): _open_border(crack, rooms[i], solid).length for i in beside}
            best = max(shared, key=lambda i: (shared[i], -i), default=None)
            if best is None or shared[best] <= 10 * GRID:
                left.append(crack)
            else:
                parts.setdefault(best, []).append(crack)
        for i, own in parts.items():
            whole = shapely.unary_union([rooms[i], *own], grid_size=GRID)
            if isinstance(whole, Polygon):
                rooms[i] = whole
                given = True
            else:
                left += own
        cracks = left
    return rooms, cracks


def _open_border(a: Polygon, b: Polygon, solid: shapely.Geometry) -> MultiLineString:
    """The part of the common border of two faces that is neither wall nor door."""
    common = shapely.get_parts(a.boundary.intersection(b.boundary))
    lines = [part for part in common if isinstance(part, LineString)]
    border = shapely.line_merge(shapely.difference(shapely.union_all(lines), solid))
    return MultiLineString(
        [part for part in shapely.get_parts(border) if isinstance(part, LineString)]
    )


def _openings(rooms: list[Polygon], solid: shapely.Geometry) -> list[Opening]:
    if not rooms:
        return []
    first, second = STRtree(rooms).query(rooms, predicate="intersects")
    return [
        Opening((int(a), int(b)), border)
        for a, b in sorted(zip(first, second, strict=True))
        if a < b
        for border in _open_border(rooms[a], rooms[b], solid).geoms
        if border.length >= DOORWAY
    ]
