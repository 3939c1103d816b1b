"""Where a robot's base stands to reach an object, or inside a region (Deeken et al., section 5.2).

To reach an object, the base needs a free pose that faces it, neither too near nor too far, with no
wall between. Inside a region, any free pose will do, and it is drawn at random.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from navgrid.area import area_cells
from navgrid.headings import footprint_cells
from navgrid.inflation import INSCRIBED
from planner.entity_lookup import LocatedEntity
from planner.route import NoRouteError
from planner.storey_costmaps import RoomCostmap, StoreyCostmaps
from planner.topology import AT_POINT
from semmap.geometry.pose import Pose

__all__ = ["NoBasePoseError", "poses_in", "poses_to_reach"]

SECTORS = 24
"""Number of sides of an object from which it may be reached."""

HEADINGS = 16
"""Number of headings that are tried in a region."""

TRIES = 200
"""Number of points of a region that are tried with each heading."""

WALLS = "room_geometry"
"""The costmap layer that has the walls."""


class NoBasePoseError(NoRouteError):
    """The robot has no free pose there; the message says why."""


def poses_to_reach(costmaps: StoreyCostmaps, target: LocatedEntity, most: int = 12) -> list[Pose]:
    """Free base poses that face an object within reach, those with the lowest costs first.

    There is at most one pose on each side of the object.

    Parameters
    ----------
    most
        Return no more poses than this.

    Raises
    ------
    NoBasePoseError
    """
    robot = costmaps.robot
    if target.place is None:
        raise NoBasePoseError(f"no room holds {target.name}: it cannot be reached")
    room, costs = costmaps.room(target.place), costmaps.costs(target.place)
    if room is None or costs is None or target.pose is None:
        raise NoBasePoseError(f"the map does not say where in {target.place} {target.name} is")
    shape = target.footprint
    if shape is None or shape.is_empty:
        shape = shapely.Point(target.pose.x, target.pose.y)
    floor = costmaps.topology.places[target.place].floor
    _refuse_height(costmaps, target, floor)
    free, points, away = _within_reach(room, costs, shape, robot.reach)
    if not len(free):
        raise NoBasePoseError(
            f"{robot.name} finds no free place within {robot.reach[1]:.2f} m of {target.name} in "
            f"{target.place}{robot.folding_hint}"
        )
    middle = shape.centroid
    towards = np.array([middle.x, middle.y]) - points
    turn = np.arctan2(-towards[:, 1], -towards[:, 0]) / (2 * math.pi) + 1
    sector = np.floor(turn * SECTORS) % SECTORS
    price = costs[free[:, 0], free[:, 1]].astype(np.int64)
    found: list[Pose] = []
    taken: set[int] = set()
    doors = _door_lines(costmaps, target.place)
    walls = _walls(costmaps, target.place)
    for i in np.lexsort((np.round(away, 3), price)):
        if int(sector[i]) in taken:
            continue
        heading = _heading_to(points[i], shape, robot.reach[1])
        if _touches(costmaps, target.place, points[i], heading, doors):
            continue
        if _is_behind_wall(walls, room, points[i], shape):
            continue
        taken.add(int(sector[i]))
        found.append(Pose.planar(float(points[i, 0]), float(points[i, 1]), heading, floor))
        if len(found) == most:
            break
    if not found:
        raise NoBasePoseError(
            f"{robot.name} cannot face {target.name} anywhere within reach: its footprint would "
            f"touch an obstacle, or a wall is between{robot.folding_hint}"
        )
    return found


def poses_in(
    costmaps: StoreyCostmaps, target: LocatedEntity, rng: np.random.Generator, most: int = 12
) -> list[Pose]:
    """Free poses drawn at random in a region: the turned footprint touches no obstacle.

    In a waypoint, a region that is only a point, the poses are at it or as near as the robot fits,
    within `AT_POINT`; those with its own heading come first.

    Parameters
    ----------
    most
        Return no more poses than this.

    Raises
    ------
    NoBasePoseError
    """
    name, robot = target.name, costmaps.robot
    outline = target.footprint
    if outline is None and target.pose is not None:
        outline = shapely.Point(target.pose.x, target.pose.y)
    if target.place is None or outline is None:
        raise NoBasePoseError(f"the map does not say in which room {name} is, or has no outline")
    if outline.area == 0:
        return [_pose_near(costmaps, target, target.place, outline.centroid)]
    room, costs = costmaps.room(target.place), costmaps.costs(target.place)
    if room is None or costs is None:
        raise NoBasePoseError(f"the map has no outline of {target.place}")
    free = (costs < INSCRIBED) & area_cells(outline, room.grid)
    rows, columns = np.nonzero(free)
    cells = np.stack([columns, rows], 1)
    points = np.array(room.grid.origin) + (cells + 0.5) * costmaps.resolution
    points = points[shapely.covers(outline, shapely.points(points))]
    floor = costmaps.topology.places[target.place].floor
    found: list[Pose] = []
    doors = _door_lines(costmaps, target.place)
    headings = 2 * math.pi * np.arange(HEADINGS) / HEADINGS + rng.uniform(-math.pi, math.pi)
    for offset in rng.permutation(HEADINGS):  # most poses are found with the first
        for k in rng.permutation(len(points))[:TRIES]:
            x, y = map(float, points[k])
            heading = math.remainder(float(headings[(offset + k) % HEADINGS]), 2 * math.pi)
            if not _touches(costmaps, target.place, points[k], heading, doors):
                found.append(Pose.planar(x, y, heading, floor))
            if len(found) == most:
                break
        if found:
            return found
    raise NoBasePoseError(f"{robot.name} finds no free pose in {name}")


def _pose_near(
    costmaps: StoreyCostmaps, target: LocatedEntity, place: str, point: shapely.Point
) -> Pose:
    """The free pose nearest to a point, with the heading nearest to that of the target."""
    room, costs = costmaps.room(place), costmaps.costs(place)
    if room is None or costs is None:
        raise NoBasePoseError(f"the map has no outline of {place}")
    _, points, away = _within_reach(room, costs, point, (0.0, AT_POINT))
    exact = np.array([[point.x, point.y]])
    if len(away) and away.min() <= room.grid.resolution:  # the point's own cell is free
        points = np.concatenate([exact, points[np.argsort(away, kind="stable")]])
    else:
        points = points[np.argsort(away, kind="stable")]
    yaw = 0.0 if target.pose is None else target.pose.yaw
    turns = sorted(2 * math.pi * np.arange(HEADINGS) / HEADINGS - math.pi, key=abs)
    floor = costmaps.topology.places[place].floor
    doors = _door_lines(costmaps, place)
    for at in points:
        for turn in turns:
            heading = math.remainder(yaw + float(turn), 2 * math.pi)
            if not _touches(costmaps, place, at, heading, doors):
                return Pose.planar(float(at[0]), float(at[1]), heading, floor)
    raise NoBasePoseError(
        f"{costmaps.robot.name} finds no free pose within {AT_POINT} m of {target.name}"
    )


def _refuse_height(costmaps: StoreyCostmaps, target: LocatedEntity, floor: float) -> None:
    robot = costmaps.robot
    if target.heights is None:
        return
    low, high = (z - floor for z in target.heights)
    if low > robot.heights[1] or high < robot.heights[0]:
        raise NoBasePoseError(
            f"{target.name} is {low:.2f} to {high:.2f} m above the floor; {robot.name} reaches "
            f"from {robot.heights[0]:.2f} to {robot.heights[1]:.2f} m"
        )


def _within_reach(
    room: RoomCostmap,
    costs: NDArray[np.uint8],
    shape: shapely.Geometry,
    reach: tuple[float, float],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """The free cells from which a shape is within reach: cells, middles, distances to it."""
    cells = np.argwhere(costs < INSCRIBED)
    points = np.array(room.grid.origin) + (cells[:, ::-1] + 0.5) * room.grid.resolution
    x0, y0, x1, y1 = shape.bounds
    near, far = reach
    close = ((points >= (x0 - far, y0 - far)) & (points <= (x1 + far, y1 + far))).all(axis=1)
    cells, points = cells[close], points[close]
    away = shapely.distance(shapely.points(points), shape)
    fits = (away >= near) & (away <= far)
    return cells[fits], points[fits], away[fits]


def _heading_to(point: NDArray[np.float64], shape: shapely.Geometry, reach: float) -> float:
    """The heading from a point to the middle of the part of a shape that is within reach."""
    base = shapely.Point(point)
    part = shapely.intersection(shape, base.buffer(reach)).centroid
    if part.is_empty:  # the buffer is a polygon inside the circle: only the nearest point is left
        part = shapely.get_point(shapely.shortest_line(base, shape), 1)
    return math.atan2(part.y - point[1], part.x - point[0])


def _walls(costmaps: StoreyCostmaps, place: str) -> NDArray[np.bool_]:
    """(rows, columns) bool: the wall cells in the window of a place, for the highest part."""
    room = costmaps.room(place)
    assert room is not None
    costmap = costmaps.costmap(costmaps.storey_of(place))
    cells = costmap.occupied.get(WALLS)
    if cells is None:
        return np.zeros(room.grid.shape, np.bool_)
    top = max(range(len(costmap.parts)), key=lambda k: costmap.parts[k].interval[1])
    walls: NDArray[np.bool_] = cells[top][room.window]
    return walls


def _is_behind_wall(
    walls: NDArray[np.bool_],
    room: RoomCostmap,
    point: NDArray[np.float64],
    shape: shapely.Geometry,
) -> bool:
    """Whether the shortest line from a point to a shape crosses a wall."""
    resolution = room.grid.resolution
    end = np.array(shapely.shortest_line(shapely.Point(point), shape).coords[-1])
    length = float(np.linalg.norm(end - point))
    steps = np.linspace(0.0, 1.0, max(2, math.ceil(2 * length / resolution)), endpoint=False)
    line = point + steps[:, None] * (end - point)
    cells = np.floor((line - room.grid.origin) / resolution).astype(int)
    inside = ((cells >= 0) & (cells < walls.shape[::-1])).all(axis=1)
    columns, rows = cells[inside].T
    return bool(walls[rows, columns].any())


def _door_lines(costmaps: StoreyCostmaps, place: str) -> list[shapely.LineString]:
    """Lines across the doorways of a place: a robot that touches one blocks the door."""
    lines = []
    for connector, _ in costmaps.topology.connectors_of(place):
        a, b = connector.poses
        middle = np.array([a.x + b.x, a.y + b.y]) / 2
        along = np.array([b.x - a.x, b.y - a.y])
        length = float(np.linalg.norm(along))
        if length > 0:
            across = np.array([-along[1], along[0]]) / length * (connector.width or 0.9) / 2
            lines.append(shapely.LineString([middle - across, middle + across]))
    return lines


def _touches(
    costmaps: StoreyCostmaps,
    place: str,
    point: NDArray[np.float64],
    heading: float,
    doors: Sequence[shapely.LineString] = (),
) -> bool:
    """Whether the footprint of a part touches a door, or an obstacle in the part's interval."""
    costmap = costmaps.costmap(costmaps.storey_of(place))
    if doors:
        cos, sin = math.cos(heading), math.sin(heading)
        turn = np.array([[cos, sin], [-sin, cos]])
        parts = [shapely.Polygon(part.footprint @ turn + point) for part in costmap.parts]
        if any(door.intersects(part) for door in doors for part in parts):
            return True
    row, column = costmap.grid.cell(float(point[0]), float(point[1]))
    for number, part in enumerate(costmap.parts):
        cells, (r, c) = footprint_cells(part.footprint, heading, costmap.grid.resolution)
        for seen, mask in _overlap(cells, row - r, column - c, costmap.grid.shape):
            if any((layer[number][seen] & mask).any() for layer in costmap.occupied.values()):
                return True
    return False


def _overlap(
    cells: NDArray[np.bool_], row: int, column: int, shape: tuple[int, int]
) -> Iterator[tuple[tuple[slice, slice], NDArray[np.bool_]]]:
    """The window of a grid that a mask at a cell covers, and that part of the mask."""
    r0, c0 = max(0, row), max(0, column)
    r1, c1 = min(shape[0], row + cells.shape[0]), min(shape[1], column + cells.shape[1])
    if r0 < r1 and c0 < c1:
        yield (slice(r0, r1), slice(c0, c1)), cells[r0 - row : r1 - row, c0 - column : c1 - column]
