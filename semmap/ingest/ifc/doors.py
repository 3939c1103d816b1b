"""The connectors of an IFC building's storeys: doors, openings in walls, open borders of spaces."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import shapely
from shapely import LineString, Polygon

from semmap.geometry.pose import Pose
from semmap.ingest.floor_plan import DOORWAY, GAP, rooms_beside
from semmap.ingest.ifc.building import IfcBuilding, IfcRoom
from semmap.ingest.ifc.ifc_file import ElementBody
from semmap.ingest.openings import make_connector, opening_pose
from semmap.ingest.world import Entry

REACH = 0.5
"""Metres from the middle of a wall within which the spaces on its sides begin."""

BODY = (0.1, 1.8)
"""Metres above the floor in which an element closes the border between two spaces, and which an
opening in a wall leaves free where one can walk through it."""


LEDGE = 0.25
"""Metres of the highest step between two floors that have an open border."""


def add_doors(building: IfcBuilding) -> None:
    """Add the doors: each joins the two spaces that it bounds, else those on both sides."""
    file = building.file
    bounds: dict[int, set[int]] = defaultdict(set)
    for each in file.of("IfcRelSpaceBoundary"):
        if each.RelatedBuildingElement is not None:
            bounds[each.RelatedBuildingElement.id()].add(each.RelatingSpace.id())
    for door in file.of("IfcDoor"):
        openings = [each.RelatingOpeningElement for each in door.FillsVoids]
        solid = next(filter(None, map(file.solid, [*openings, door])), None)
        spaces = _spaces_of(building, door)
        if solid is None:
            building.skip(door, "has no shape", "Export doors with their geometry.")
            continue
        line = _across(solid, _heading(file.solid(door) or solid, file.placement(door).yaw))
        joined = _beside(spaces, line)
        stated = [space for space in spaces if space.number in bounds[door.id()]]
        if len(stated) == 2:
            joined = stated
        if joined:
            width = file.length(door, "OverallWidth") or line.length
            type_ = "elevator_door" if any(space.is_cabin for space in joined) else "door"
            entry = Entry(building.name_of(door), "connector", type_, label=door.Name)
            _connect(building, entry, line, joined, width, file.length(door, "OverallHeight"), door)
        elif building.spaces:
            fix = "Add a connector with joins."
            building.skip(door, "has no space, or the same one, on its sides", fix)


def add_openings(building: IfcBuilding) -> None:
    """Add openings in walls that nothing fills, and borders of spaces on which nothing stands."""
    for opening in building.file.of("IfcOpeningElement"):
        solid = building.file.solid(opening)
        walls = [each.RelatingBuildingElement for each in opening.VoidsElements]
        wall = next((w for w in walls if w.is_a("IfcWall")), None)
        spaces = _spaces_of(building, wall)
        if solid is None or not spaces or opening.HasFillings:
            continue
        low, high = solid.box[:, 2] - spaces[0].storey.elevation
        body = building.file.solid(wall)
        if low <= BODY[0] and high >= BODY[1] and body is not None:
            line = _across(solid, _long_side(body))
            joined = _beside(spaces, line)
            if len(joined) == 2:
                entry = Entry(f"{joined[0].name}-{joined[1].name}", "connector", "opening")
                _connect(building, entry, line, joined, line.length, float(high - low), opening)
    for pair in combinations(building.spaces, 2):
        level = pair[0].storey == pair[1].storey and abs(pair[0].floor - pair[1].floor) <= LEDGE
        if level and pair[0].outline.distance(pair[1].outline) <= GAP:
            line = _free_border(building, *pair)
            if line is not None and line.length >= DOORWAY:
                entry = Entry(f"{pair[0].name}-{pair[1].name}", "connector", "opening")
                _connect(building, entry, line, pair, line.length, None)


def _spaces_of(building: IfcBuilding, element: Any) -> list[IfcRoom]:
    """The spaces of the storey that an element is in."""
    storey = None if element is None else building.storey_of(element)
    return [space for space in building.spaces if space.storey == storey]


def _across(solid: ElementBody, yaw: float) -> LineString:
    """The line of an opening: the extent of its body along a heading, at the middle across it."""
    to_wall = Pose.planar(0.0, 0.0, yaw)
    x, y, _ = to_wall.inverse().apply(solid.points).T
    ends = [(each, (y.min() + y.max()) / 2, 0.0) for each in (x.min(), x.max())]
    return LineString(to_wall.apply(ends)[:, :2])


def _heading(body: ElementBody, yaw: float) -> float:
    """The heading along a door: as it is placed, unless its body is twice as long across that."""
    turned = yaw + math.pi / 2
    return turned if _across(body, turned).length > 2 * _across(body, yaw).length else yaw


def _long_side(body: ElementBody) -> float:
    """The heading of the long side of the rectangle around a body seen from above."""
    around = shapely.MultiPoint(body.points[:, :2]).minimum_rotated_rectangle
    sides = np.diff(shapely.get_coordinates(around)[:3], axis=0)
    x, y = max(sides.tolist(), key=lambda side: math.hypot(*side))
    return math.atan2(y, x)


def _beside(spaces: Sequence[IfcRoom], line: LineString) -> list[IfcRoom]:
    """The spaces on both sides of a line; none where the same is on both."""
    sides = rooms_beside([space.outline for space in spaces], line, REACH)
    found = [spaces[side] for side in sides if side is not None]
    return found if sides.left != sides.right else []


def _connect(
    building: IfcBuilding,
    entry: Entry,
    line: LineString,
    joined: Sequence[IfcRoom],
    width: float,
    height: float | None,
    element: Any = None,
) -> None:
    """Add a connector whose x axis leads from the first of one or two spaces to the other side."""
    last = joined[-1].outline
    left, right = (line.offset_curve(side).distance(last) for side in (REACH, -REACH))
    frame = opening_pose(line, from_left=(left > right) == (len(joined) == 2))
    entry.holder = joined[0].storey.name
    places = [(space.name, space.outline) for space in joined]
    make_connector(entry, frame, places, round(width, 3), height and round(height, 3))
    building.add(entry, element)


def _free_border(building: IfcBuilding, first: IfcRoom, second: IfcRoom) -> LineString | None:
    """The longest straight part of the border of two spaces on which no element stands."""
    border = first.outline.boundary.intersection(second.outline.buffer(GAP, cap_style="flat"))
    low, high = (first.storey.elevation + height for height in BODY)
    x0, y0, x1, y1 = border.bounds
    occupied = [Polygon()]
    for element in building.file.of("IfcElement"):
        solid = building.file.solid(element)
        if solid is None or element.is_a("IfcFeatureElement"):
            continue
        (left, front, bottom), (right, back, top) = solid.box
        if (
            bottom < high
            and top > low
            and left <= x1
            and right >= x0
            and front <= y1
            and back >= y0
        ):
            z = solid.triangles[:, :, 2]
            near = solid.triangles[(z.min(axis=1) < high) & (z.max(axis=1) > low)]
            occupied += [shapely.MultiPoint(each).convex_hull for each in near[:, :, :2]]
    free = border.difference(shapely.union_all(occupied).buffer(GAP))
    return max(_segments(free), key=lambda line: line.length, default=None)


def _segments(lines: shapely.Geometry) -> Iterator[LineString]:
    for part in shapely.get_parts(shapely.line_merge(lines)):
        points = shapely.get_coordinates(shapely.simplify(part, 1e-3))
        for pair in pairwise(points):
            yield LineString(pair)
