"""Rooms from a floor plan drawn as lines: the faces that walls and doors enclose."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, MultiPolygon, Point, Polygon, STRtree
from shapely.ops import substring

from semmap.geometry.morphology import polygons
from semmap.geometry.overlay import common, united, without

GRID = 1e-4
"""Lines are noded on a grid of 0.1 mm, so that a line which ends on another really meets it."""

NARROWEST = 0.4
"""A face in which no disc of this diameter (metres) fits is a crack between lines, not a room."""

DOORWAY = 0.5
"""A border without wall or door is an opening from this length (metres) on."""

GAP, CABIN_GAP = 0.05, 0.5
"""Metres by which lines may miss each other, and elevator doors their shaft."""

SMALLEST, SMALLEST_CLOSED = 0.5, 2.0
"""Square metres from which a face is a room, and one into which no door or opening leads."""

CLEARANCE = 0.05
"""Metres beside a door at which rooms begin."""

BESIDE = 0.15
ALONG = 0.8
"""A border runs along a wall if it is this near (metres), at an angle with at least this cosine:
floors are seldom drawn exactly to their walls."""


@dataclass(frozen=True)
class Opening:
    """A border between two rooms without wall or door: their indices, and the border."""

    rooms: tuple[int, int]
    border: LineString


@dataclass
class FloorPlan:
    """The faces that lines enclose; rooms from top to bottom and left to right, metres."""

    rooms: list[Polygon] = field(default_factory=list)
    openings: list[Opening] = field(default_factory=list)  # can be walked through
    floorless: list[Polygon] = field(default_factory=list)  # large: shafts, voids, courtyards
    solid: list[Polygon] = field(default_factory=list)  # without a door: columns, ducts


class Sides(NamedTuple):
    """The rooms to the left and to the right of a directed line; None where there is none."""

    left: int | None
    right: int | None


def bridge_gaps(
    lines: Sequence[LineString], gap: float, ends: Sequence[LineString] | None = None
) -> list[LineString]:
    """Return lines that close gaps of at most `gap` metres from `ends` (`lines`) to `lines`."""
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
) -> FloorPlan:
    """Return the rooms of a storey; lengths are metres.

    Lines of walls, doors and floor outlines are joined where they miss each other by at most `GAP`,
    noded, and polygonised. A crack (for example between a wall and the floor outline drawn beside
    it) joins the room to which it is open. Where there are floors, a face must lie on them; a
    border that is nothing but their outline is an opening. Elevator cabins are cut out of the
    rooms; their doors, with the cabin to their right, stand in the opening of a shaft and are
    joined to what is within `CABIN_GAP` of their ends.
    """
    rings = [ring for floor in floors for ring in (floor.exterior, *floor.interiors)]
    outlines = [side for ring in rings for side in straight_parts(ring)]
    drawn = [line for line in (*walls, *doors, *outlines, *cabin_doors) if line.length > 0]
    if not drawn:
        return FloorPlan()
    bridges = bridge_gaps(drawn, GAP)
    if cabin_doors:
        bridges += bridge_gaps([*walls, *doors], CABIN_GAP, cabin_doors)
    noded = shapely.unary_union([*drawn, *bridges], grid_size=GRID)
    barriers = [*walls, *doors, *cabin_doors]

    faces = list(shapely.polygonize([noded]).geoms)
    faces = _fill_cracks(faces, [*barriers, *bridges])
    plan = FloorPlan()
    faces, around_cabins = _without_cabins(faces, cabins)
    faces = _on_floors(faces, floors, plan)
    faces.sort(key=reading_order)

    openings = open_borders(faces, barriers)
    reached = {i for opening in openings for i in opening.rooms}
    for door in doors:
        reached.update(i for i in rooms_beside(faces, door) if i is not None)
    for door in cabin_doors:
        before = rooms_beside(faces, door, reach=CABIN_GAP).left
        reached |= {before} if before is not None else set()
    numbers: dict[int, int] = {}
    for i, face in enumerate(faces):
        if i in reached or (face.area >= SMALLEST_CLOSED and face not in around_cabins):
            numbers[i] = len(plan.rooms)
            plan.rooms.append(face.simplify(GRID))
        else:
            plan.solid.append(face)
    for opening in openings:
        a, b = opening.rooms
        plan.openings.append(Opening((numbers[a], numbers[b]), opening.border))
    return plan


def rooms_beside(rooms: Sequence[Polygon], line: LineString, reach: float = 0.3) -> Sides:
    """Return the rooms on both sides of a door, found by the strips along it.

    The strips leave out the outer tenths of the line and begin `CLEARANCE` beside it; of several
    rooms in a strip `reach` metres deep, the one that fills most of it counts.
    """
    tree = STRtree(rooms)
    middle = substring(line, 0.1, 0.9, normalized=True)

    def beside(sign: int) -> int | None:
        strip = shapely.difference(
            middle.buffer(sign * (CLEARANCE + reach), single_sided=True),
            middle.buffer(sign * CLEARANCE, single_sided=True),
        )
        near = [int(i) for i in tree.query(strip, predicate="intersects")]
        filled = {i: common(rooms[i], strip).area for i in near}
        best = max(filled, key=lambda i: (filled[i], -i), default=None)
        return best if best is not None and filled[best] > 0.1 * strip.area else None

    return Sides(beside(1), beside(-1))


def middle_of(area: Polygon | MultiPolygon) -> Point:
    """Return a point of the area, its centroid where that lies in it."""
    return area.centroid if area.contains(area.centroid) else area.representative_point()


def straight_parts(line: LineString) -> list[LineString]:
    """Return the straight parts of a line."""
    return [LineString(pair) for pair in itertools.pairwise(shapely.get_coordinates(line))]


def _is_roomy(face: Polygon) -> bool:
    return bool(face.area >= SMALLEST and not face.buffer(-NARROWEST / 2).is_empty)


def reading_order(face: Polygon) -> tuple[float, float]:
    """Return a sort key from top to bottom in rows of a decimetre, then left to right.

    The rows' borders lie off the round numbers that people draw at, so that noise does not
    move a room to the next row.
    """
    middle: Point = face.centroid
    return (-round(middle.y + 0.0337, 1), round(middle.x, 3))


def _fill_cracks(faces: list[Polygon], barriers: Sequence[LineString]) -> list[Polygon]:
    """Join each crack to the room with which it shares the longest border that is not solid."""
    solid = shapely.union_all([b.buffer(10 * GRID) for b in barriers])
    rooms = [f for f in faces if _is_roomy(f)]
    cracks = [f for f in faces if not _is_roomy(f)]
    given = True
    while given and rooms and cracks:
        given = False
        tree = STRtree(rooms)
        left: list[Polygon] = []
        parts: dict[int, list[Polygon]] = {}
        for crack in cracks:
            shared = {
                int(i): sum(p.difference(solid).length for p in _common_border(crack, rooms[i]))
                for i in tree.query(crack, predicate="intersects")
            }
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
    return rooms


def _without_cabins(
    faces: list[Polygon], cabins: Sequence[Polygon]
) -> tuple[list[Polygon], list[Polygon]]:
    """Cut the cabins out of the faces; returns all that is left, and the parts that were cut."""
    if not cabins:
        return faces, []
    taken = united(cabins)
    rest = [face for face in faces if not face.intersects(taken)]
    met = [without(face, taken) for face in faces if face.intersects(taken)]
    cut = [part for face in met for part in polygons(face) if _is_roomy(part)]
    return rest + cut, cut


def _on_floors(faces: list[Polygon], floors: Sequence[Polygon], plan: FloorPlan) -> list[Polygon]:
    """The faces of which more than half lies on a floor; all, where no floor is drawn."""
    if not floors:
        return faces
    ground = united(floors)
    covered = (
        shapely.area(shapely.intersection(faces, ground, grid_size=GRID)) > shapely.area(faces) / 2
    )
    plan.floorless += [face for face, on in zip(faces, covered, strict=True) if not on]
    return [face for face, on in zip(faces, covered, strict=True) if on]


def _common_border(a: Polygon, b: Polygon) -> list[LineString]:
    shared = shapely.get_parts(a.boundary.intersection(b.boundary))
    return [part for part in shared if isinstance(part, LineString)]


def open_borders(rooms: Sequence[Polygon], barriers: Sequence[LineString]) -> list[Opening]:
    """Return the common borders of rooms, without what runs along a wall or door."""
    if not rooms:
        return []
    tree = STRtree(barriers)
    first, second = STRtree(rooms).query(rooms, predicate="intersects")
    found = []
    for a, b in sorted(zip(first.tolist(), second.tolist(), strict=True)):
        if a >= b:
            continue
        sides = [s for line in _common_border(rooms[a], rooms[b]) for s in straight_parts(line)]
        free = [_without_barriers(side, barriers, tree) for side in sides]
        borders = shapely.get_parts(shapely.line_merge(shapely.union_all(free)))
        found += [Opening((a, b), border) for border in borders if border.length >= DOORWAY]
    return found


def _without_barriers(
    side: LineString, barriers: Sequence[LineString], tree: STRtree
) -> shapely.Geometry:
    """What of a straight border has no wall or door beside it, in about its direction."""
    direction = _direction(side)
    near = [barriers[i] for i in tree.query(side, predicate="dwithin", distance=BESIDE)]
    along = [b for b in near if abs(_direction(b) @ direction) > ALONG]
    return side.difference(shapely.union_all([b.buffer(BESIDE, cap_style="flat") for b in along]))


def _direction(line: LineString) -> NDArray[np.float64]:
    start, end = shapely.get_coordinates(line)[[0, -1]]
    step: NDArray[np.float64] = end - start
    return step / np.linalg.norm(step)
