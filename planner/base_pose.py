"""Where a robot's base stands: to reach a thing, or somewhere in a region (Deeken et al., 5.2).

To reach a thing means a free pose, facing it, from which it is neither too near nor too far, with
no wall between; in a region any admissible pose serves, drawn by chance.
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
from planner.ground import Ground
from planner.route import NoRouteError
from planner.target import Target
from semmap.geometry.pose import Pose

__all__ = ["NoBasePoseError", "poses_in", "poses_to_reach"]

SECTORS = 24
"""Sides of a thing from which it may be reached."""

HEADINGS = 16
"""Ways to turn that are tried in a region."""

TRIES = 200
"""Points of a region that are tried with one of them each."""

WALLS = "room_geometry"


class NoBasePoseError(NoRouteError):
    """A robot finds no free pose there; the message says why."""


def poses_to_reach(ground: Ground, target: Target, most: int = 12) -> list[Pose]:
    """Free base poses that face a thing and from which the robot reaches it, clear ones first.

    At most one from each side of it.

    Raises
    ------
    NoBasePoseError
    """
    robot = ground.robot
    if target.place is None:
        raise NoBasePoseError(f"no room holds {target.name}: it cannot be reached")
    room, costs = ground.room(target.place), ground.costs(target.place)
    if room is None or costs is None or target.pose is None:
        raise NoBasePoseError(f"the map does not know where in {target.place} {target.name} is")
    shape = target.footprint
    if shape is None or shape.is_empty:
        shape = shapely.Point(target.pose.x, target.pose.y)
    floor = ground.topology.places[target.place].floor
    if target.heights is not None:
        low, high = (z - floor for z in target.heights)
        if low > robot.heights[1] or high < robot.heights[0]:
            raise NoBasePoseError(
                f"{target.name} is {low:.2f} to {high:.2f} m above the floor; {robot.name} reaches "
                f"from {robot.heights[0]:.2f} to {robot.heights[1]:.2f} m"
            )
    free = np.argwhere(costs < INSCRIBED)
    points = np.array(room.grid.origin) + (free[:, ::-1] + 0.5) * room.grid.resolution
    x0, y0, x1, y1 = shape.bounds
    far = robot.reach[1]
    near = ((points >= (x0 - far, y0 - far)) & (points <= (x1 + far, y1 + far))).all(axis=1)
    free, points = free[near], points[near]
    away = shapely.distance(shapely.points(points), shape)
    fits = (away >= robot.reach[0]) & (away <= far)
    free, points, away = free[fits], points[fits], away[fits]
    if not len(free):
        raise NoBasePoseError(
            f"{robot.name} finds no free place within {far:.2f} m of {target.name} in "
            f"{target.place}"
        )
    middle = shape.centroid
    to = np.array([middle.x, middle.y]) - points
    doors = _doors(ground, target.place)
    sector = np.floor((np.arctan2(-to[:, 1], -to[:, 0]) / (2 * math.pi) + 1) * SECTORS) % SECTORS
    price = costs[free[:, 0], free[:, 1]].astype(np.int64)
    order = np.lexsort((np.round(away, 3), price))
    found: list[Pose] = []
    taken: set[int] = set()
    walls = _walls(ground, target.place)
    for i in order:
        if int(sector[i]) in taken:
            continue
        part = shapely.intersection(shape, shapely.Point(points[i]).buffer(far)).centroid
        heading = math.atan2(part.y - points[i, 1], part.x - points[i, 0])
        if _touches(ground, target.place, points[i], heading, doors):
            continue
        if _behind_a_wall(walls, room.grid.origin, room.grid.resolution, points[i], shape):
            continue
        taken.add(int(sector[i]))
        found.append(Pose.planar(float(points[i, 0]), float(points[i, 1]), heading, floor))
        if len(found) == most:
            break
    if not found:
        raise NoBasePoseError(
            f"{robot.name} cannot turn to {target.name} anywhere within its reach: its footprint "
            "would touch something, or a wall is between"
        )
    return found


def poses_in(
    ground: Ground, target: Target, rng: np.random.Generator, most: int = 12
) -> list[Pose]:
    """Admissible poses drawn from a region: free of obstacles for this robot, as it is turned.

    Raises
    ------
    NoBasePoseError
    """
    name, robot = target.name, ground.robot
    if target.place is None or target.footprint is None:
        raise NoBasePoseError(f"the map does not know in which room {name} is, or what it covers")
    room, costs = ground.room(target.place), ground.costs(target.place)
    if room is None or costs is None:
        raise NoBasePoseError(f"the map does not know what {target.place} covers")
    free = (costs < INSCRIBED) & area_cells(target.footprint, room.grid)
    rows, columns = np.nonzero(free)
    points = np.array(room.grid.origin) + (np.stack([columns, rows], 1) + 0.5) * ground.resolution
    points = points[shapely.covers(target.footprint, shapely.points(points))]
    floor = ground.topology.places[target.place].floor
    found: list[Pose] = []
    doors = _doors(ground, target.place)
    turns = 2 * math.pi * np.arange(HEADINGS) / HEADINGS + rng.uniform(-math.pi, math.pi)
    for turn in rng.permutation(HEADINGS):  # most poses are found with the first
        for k in rng.permutation(len(points))[:TRIES]:
            x, y = map(float, points[k])
            heading = math.remainder(float(turns[(turn + k) % HEADINGS]), 2 * math.pi)
            if not _touches(ground, target.place, points[k], heading, doors):
                found.append(Pose.planar(x, y, heading, floor))
            if len(found) == most:
                break
        if found:
            return found
    raise NoBasePoseError(f"{robot.name} finds no free pose in {name}")


def _walls(ground: Ground, place: str) -> NDArray[np.bool_]:
    """(rows, columns) bool: the cells of walls in a place's window, for the highest part."""
    room = ground.room(place)
    assert room is not None
    costmap = ground.costmap(ground.storey_of(place))
    cells = costmap.occupied.get(WALLS)
    if cells is None:
        return np.zeros(room.grid.shape, np.bool_)
    top = max(range(len(costmap.parts)), key=lambda k: costmap.parts[k].interval[1])
    walls: NDArray[np.bool_] = cells[top][room.window]
    return walls


def _behind_a_wall(
    walls: NDArray[np.bool_],
    origin: tuple[float, float],
    resolution: float,
    point: NDArray[np.float64],
    shape: shapely.Geometry,
) -> bool:
    """Whether the straight line from a point to a shape meets a wall before it gets there."""
    end = np.array(shapely.shortest_line(shapely.Point(point), shape).coords[-1])
    length = float(np.linalg.norm(end - point))
    steps = np.linspace(0.0, 1.0, max(2, math.ceil(2 * length / resolution)), endpoint=False)
    line = point + steps[:, None] * (end - point)
    cells = np.floor((line - origin) / resolution).astype(int)
    rows, columns = cells[:, 1], cells[:, 0]
    inside = (
        (rows >= 0) & (rows < walls.shape[0]) & (columns >= 0) & (columns < walls.shape[1])
    )  # fmt: skip
    return bool(walls[rows[inside], columns[inside]].any())


def _doors(ground: Ground, place: str) -> list[shapely.LineString]:
    """Across the openings of a place: whoever stands there is in the way of a door, or in one."""
    lines = []
    for connector, _ in ground.topology.doors_of(place):
        a, b = connector.poses
        middle = np.array([a.x + b.x, a.y + b.y]) / 2
        along = np.array([b.x - a.x, b.y - a.y])
        length = float(np.linalg.norm(along))
        if length > 0:
            across = np.array([-along[1], along[0]]) / length * (connector.width or 0.9) / 2
            lines.append(shapely.LineString([middle - across, middle + across]))
    return lines


def _touches(
    ground: Ground,
    place: str,
    point: NDArray[np.float64],
    heading: float,
    doors: Sequence[shapely.LineString] = (),
) -> bool:
    """Whether a part's footprint, turned, touches a door, or what is in its interval there."""
    costmap = ground.costmap(ground.storey_of(place))
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
    """The window of a grid that a mask laid at a cell covers, and that part of the mask."""
    r0, c0 = max(0, row), max(0, column)
    r1, c1 = min(shape[0], row + cells.shape[0]), min(shape[1], column + cells.shape[1])
    if r0 < r1 and c0 < c1:
        yield (slice(r0, r1), slice(c0, c1)), cells[r0 - row : r1 - row, c0 - column : c1 - column]
