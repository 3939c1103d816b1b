"""Where a robot's base stands to reach an object or in a region (Deeken et al., section 5.2).

It stands on the ground of a room, `RoomGround`: a part of a costmap, which knows no names.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from navgrid.costmap import Costmap
from navgrid.grid import Grid
from navgrid.headings import footprint_cells
from navgrid.inflation import INSCRIBED
from navgrid.slabs import area_cells
from navgrid.window import Window
from planner.location import LocatedEntity
from planner.robot_class import RobotClass
from planner.route import NoRouteError
from planner.topology import AT_POINT
from semmap.geometry.pose import Pose

if TYPE_CHECKING:
    from planner.storey_costmaps import StoreyCostmaps

WALLS = "room_geometry"  # the costmap layer that has the walls
SECTORS = 24  # sides of an object from which it may be reached
HEADINGS = 16  # headings that are tried in a region
TESTED = 400  # bases of an arm whose footprints are tested
TRIES = 200  # points of a region that are tried with each heading


@dataclass(frozen=True, eq=False)
class RoomGround:
    """The part of a storey's costmap that a room covers, for one class of robots.

    `window` are the rows and columns of the storey's grid that `grid` and `costs` (rows, columns)
    uint8 cover; costs are unknown outside of the room and its doorways. `floor` is the height of
    the floor in the map's frame, metres. A robot that touches one of the lines `doors` blocks a
    doorway.
    """

    place: str
    robot: RobotClass
    costmap: Costmap
    window: Window
    grid: Grid
    costs: NDArray[np.uint8]
    floor: float
    doors: tuple[shapely.LineString, ...] = ()

    def free(
        self, within: tuple[float, float, float, float] | None = None
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The free cells of the window, (N, 2), and their middles, metres.

        `within` are the least and greatest x and y, metres, of cells that are wanted.
        """
        first = np.zeros(2, np.int64)
        costs = self.costs
        if within is not None:
            ends = np.array([within[1::-1], within[:1:-1]]) - self.grid.origin[::-1]
            first, last = np.floor(ends / self.grid.resolution).astype(np.int64).clip(0)
            costs = costs[first[0] : last[0] + 1, first[1] : last[1] + 1]
        cells = np.argwhere(costs < INSCRIBED) + first
        return cells, np.array(self.grid.origin) + (cells[:, ::-1] + 0.5) * self.grid.resolution

    def near(
        self, shape: shapely.Geometry, reach: tuple[float, float]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """The free cells from which a shape is within reach: cells, middles, distances to it."""
        x0, y0, x1, y1 = shape.bounds
        near, far = reach
        cells, points = self.free((x0 - far, y0 - far, x1 + far, y1 + far))
        away = shapely.distance(shapely.points(points), shape)
        fits = (away >= near) & (away <= far)
        return cells[fits], points[fits], away[fits]

    def touches(self, point: NDArray[np.float64], heading: float) -> bool:
        """Whether the footprint of a part touches a door, or an obstacle at the part's heights."""
        costmap = self.costmap
        if self.doors:
            cos, sin = math.cos(heading), math.sin(heading)
            turn = np.array([[cos, sin], [-sin, cos]])
            parts = [shapely.Polygon(part.footprint @ turn + point) for part in costmap.parts]
            if any(door.intersects(part) for door in self.doors for part in parts):
                return True
        row, column = costmap.grid.cell(float(point[0]), float(point[1]))
        for number, part in enumerate(costmap.parts):
            cells, (r, c) = footprint_cells(part.footprint, heading, costmap.grid.resolution)
            for seen, mask in _overlap(cells, row - r, column - c, costmap.grid.shape):
                if any((layer[number][seen] & mask).any() for layer in costmap.occupied.values()):
                    return True
        return False

    def walls(self) -> NDArray[np.bool_]:
        """(rows, columns) bool: the wall cells of the window at the heights of the highest part."""
        cells = self.costmap.occupied.get(WALLS)
        if cells is None:
            return np.zeros(self.grid.shape, np.bool_)
        parts = self.costmap.parts
        top = max(range(len(parts)), key=lambda k: parts[k].interval[1])
        walls: NDArray[np.bool_] = cells[top][self.window]
        return walls


def _overlap(
    cells: NDArray[np.bool_], row: int, column: int, shape: tuple[int, int]
) -> Iterator[tuple[Window, NDArray[np.bool_]]]:
    """The window of a grid that a mask at a cell covers, and that part of the mask."""
    r0, c0 = max(0, row), max(0, column)
    r1, c1 = min(shape[0], row + cells.shape[0]), min(shape[1], column + cells.shape[1])
    if r0 < r1 and c0 < c1:
        yield (slice(r0, r1), slice(c0, c1)), cells[r0 - row : r1 - row, c0 - column : c1 - column]


class NoBasePoseError(NoRouteError):
    """The robot has no free pose there; the message says why."""


def poses_to_reach(ground: RoomGround | None, target: LocatedEntity, most: int = 12) -> list[Pose]:
    """Free base poses that face an object within reach, those with the lowest costs first.

    There is at most one pose on each side of the object. `ground` is that of its room; None if the
    map has no outline of it. Raises NoBasePoseError.
    """
    return list(islice(facing_poses(ground, target), most))


def facing_poses(
    ground: RoomGround | None, target: LocatedEntity, band: float = math.inf
) -> Iterator[Pose]:
    """The poses of `poses_to_reach`, each found when it is asked for.

    On each side there is one in each `band`, metres, of distances to the object.
    """
    shape = _shape_near(ground, target)
    assert ground is not None
    robot = ground.robot
    free, points, away = ground.near(shape, robot.reach)
    if not len(free):
        raise NoBasePoseError(
            f"{robot.name} finds no free place within {robot.reach[1]:.2f} m of {target.name} in "
            f"{target.place}{robot.folding_hint}"
        )
    sides = _sides(points, away, shape, band)
    price = ground.costs[free[:, 0], free[:, 1]].astype(np.int64)
    taken: set[tuple[float, ...]] = set()
    walls = ground.walls()
    for i in np.lexsort((np.round(away, 3), price)):
        side = tuple(sides[i].tolist())
        if side in taken:
            continue
        heading = _heading_to(points[i], shape, robot.reach[1])
        if pose := _free_pose(ground, walls, points[i], heading, shape):
            taken.add(side)
            yield pose
    if not taken:
        raise NoBasePoseError(
            f"{robot.name} cannot face {target.name} anywhere within reach: its footprint would "
            f"touch an obstacle, or a wall is between{robot.folding_hint}"
        )


def _shape_near(ground: RoomGround | None, target: LocatedEntity) -> shapely.Geometry:
    """The outline of an object; NoBasePoseError where it is not known, or too high or low."""
    if target.place is None:
        raise NoBasePoseError(f"no room holds {target.name}: it cannot be reached")
    if ground is None or target.pose is None:
        raise NoBasePoseError(f"the map does not say where in {target.place} {target.name} is")
    _refuse_height(ground, target)
    if target.footprint is None or target.footprint.is_empty:
        return shapely.Point(target.pose.x, target.pose.y)
    return target.footprint


def _sides(
    points: NDArray[np.float64], away: NDArray[np.float64], shape: shapely.Geometry, band: float
) -> NDArray[np.float64]:
    """(N, 2) on which side of a shape points are, and in which band of distances."""
    middle = shape.centroid
    x, y = (points - (middle.x, middle.y)).T
    turn = np.arctan2(y, x) / (2 * math.pi) + 1
    return np.column_stack([np.floor(turn * SECTORS) % SECTORS, np.floor(away / band)])


def _free_pose(
    ground: RoomGround,
    walls: NDArray[np.bool_],
    point: NDArray[np.float64],
    heading: float,
    shape: shapely.Geometry,
) -> Pose | None:
    """The pose at a point, unless it touches something there, or a wall hides the shape."""
    if ground.touches(point, heading) or _is_behind_wall(walls, ground, point, shape):
        return None
    return Pose.planar(float(point[0]), float(point[1]), heading, ground.floor)


def free_stances(
    ground: RoomGround | None, target: LocatedEntity, bases: NDArray[np.float64], band: float
) -> Iterator[tuple[int, Pose]]:
    """Which of some bases (N, 3), x, y and yaw, are free near an object; clear ones first.

    On each side of the object there is one in each `band`, metres, until others were tried.
    """
    shape = _shape_near(ground, target)
    assert ground is not None
    cells = np.floor((bases[:, :2] - ground.grid.origin) / ground.grid.resolution).astype(np.int64)
    rows, columns = cells[:, 1], cells[:, 0]
    inside = (cells >= 0).all(axis=1) & (rows < ground.grid.shape[0])
    chosen = np.flatnonzero(inside & (columns < ground.grid.shape[1]))
    chosen = chosen[ground.costs[rows[chosen], columns[chosen]] < INSCRIBED]
    points = bases[chosen, :2]
    away = shapely.distance(shapely.points(points), shape)
    price = ground.costs[rows[chosen], columns[chosen]].astype(np.int64)
    order = np.lexsort((np.round(away, 3), price))
    sides = _sides(points, away, shape, band)
    walls = ground.walls()
    later: list[np.intp] = []
    taken: set[tuple[float, ...]] = set()
    tested = 0
    for first, some in ((True, order), (False, later)):
        for i in some:
            side = tuple(sides[i].tolist())
            if first and side in taken:
                later.append(i)
                continue
            if tested == TESTED:
                return
            tested += 1
            if pose := _free_pose(ground, walls, points[i], float(bases[chosen[i], 2]), shape):
                taken.add(side)
                yield int(chosen[i]), pose


def poses_in(
    ground: RoomGround | None,
    target: LocatedEntity,
    rng: np.random.Generator,
    most: int = 12,
) -> list[Pose]:
    """Free poses drawn at random in a region: the turned footprint touches no obstacle.

    In a waypoint, a region that is only a point, the poses are at it or as near as the robot fits,
    within `AT_POINT`; those with its own heading come first. `ground` is as for `poses_to_reach`.
    Raises NoBasePoseError.
    """
    name, outline = target.name, target.footprint
    if outline is None and target.pose is not None:
        outline = shapely.Point(target.pose.x, target.pose.y)
    if target.place is None or outline is None:
        raise NoBasePoseError(f"the map does not say in which room {name} is, or has no outline")
    if ground is None:
        raise NoBasePoseError(f"the map has no outline of {target.place}")
    if outline.area == 0:
        return [_pose_near(ground, target, outline.centroid)]
    cells, points = ground.free()
    points = points[area_cells(outline, ground.grid)[tuple(cells.T)]]
    points = points[shapely.covers(outline, shapely.points(points))]
    found: list[Pose] = []
    headings = 2 * math.pi * np.arange(HEADINGS) / HEADINGS + rng.uniform(-math.pi, math.pi)
    for offset in rng.permutation(HEADINGS):  # most poses are found with the first
        for k in rng.permutation(len(points))[:TRIES]:
            x, y = map(float, points[k])
            heading = math.remainder(float(headings[(offset + k) % HEADINGS]), 2 * math.pi)
            if not ground.touches(points[k], heading):
                found.append(Pose.planar(x, y, heading, ground.floor))
            if len(found) == most:
                break
        if found:
            return found
    raise NoBasePoseError(f"{ground.robot.name} finds no free pose in {name}")


def _pose_near(ground: RoomGround, target: LocatedEntity, point: shapely.Point) -> Pose:
    """The free pose nearest to a point, with the heading nearest to that of the target."""
    _, points, away = ground.near(point, (0.0, AT_POINT))
    nearest = points[np.argsort(away, kind="stable")]
    if len(away) and away.min() <= ground.grid.resolution:  # the point's own cell is free
        nearest = np.concatenate([np.array([[point.x, point.y]]), nearest])
    yaw = 0.0 if target.pose is None else target.pose.yaw
    turns = sorted(2 * math.pi * np.arange(HEADINGS) / HEADINGS - math.pi, key=abs)
    for at in nearest:
        for turn in turns:
            heading = math.remainder(yaw + float(turn), 2 * math.pi)
            if not ground.touches(at, heading):
                return Pose.planar(float(at[0]), float(at[1]), heading, ground.floor)
    raise NoBasePoseError(
        f"{ground.robot.name} finds no free pose within {AT_POINT} m of {target.name}"
    )


def _refuse_height(ground: RoomGround, target: LocatedEntity) -> None:
    if target.heights is None:
        return
    robot = ground.robot
    low, high = (z - ground.floor for z in target.heights)
    if low > robot.heights[1] or high < robot.heights[0]:
        raise NoBasePoseError(
            f"{target.name} is {low:.2f} to {high:.2f} m above the floor; {robot.name} reaches "
            f"from {robot.heights[0]:.2f} to {robot.heights[1]:.2f} m"
        )


def _heading_to(point: NDArray[np.float64], shape: shapely.Geometry, reach: float) -> float:
    """The heading from a point to the middle of the part of a shape that is within reach."""
    base = shapely.Point(point)
    part = shapely.intersection(shape, base.buffer(reach)).centroid
    if part.is_empty:  # the buffer is a polygon inside the circle: only the nearest point is left
        part = shapely.get_point(shapely.shortest_line(base, shape), 1)
    return math.atan2(part.y - point[1], part.x - point[0])


def _is_behind_wall(
    walls: NDArray[np.bool_],
    ground: RoomGround,
    point: NDArray[np.float64],
    shape: shapely.Geometry,
) -> bool:
    """Whether the shortest line from a point to a shape crosses a wall."""
    resolution = ground.grid.resolution
    end = np.array(shapely.shortest_line(shapely.Point(point), shape).coords[-1])
    length = float(np.linalg.norm(end - point))
    steps = np.linspace(0.0, 1.0, max(2, math.ceil(2 * length / resolution)), endpoint=False)
    line = point + steps[:, None] * (end - point)
    cells = np.floor((line - ground.grid.origin) / resolution).astype(int)
    inside = ((cells >= 0) & (cells < walls.shape[::-1])).all(axis=1)
    columns, rows = cells[inside].T
    return bool(walls[rows, columns].any())


DOOR_CLEARANCE = 0.8  # metres from the passage of a connector that stay free
WAY_CLEARANCE = 0.5  # metres on both sides of the paths between connectors that stay free


def floor_spot(costmaps: StoreyCostmaps, place: str) -> LocatedEntity:
    """The free part of a floor that is nearest to the first door, off all doors and ways.

    Raises NoBasePoseError if there is none.
    """
    ground = costmaps.ground(place)
    if ground is None:
        raise NoBasePoseError(f"the map has no outline of {place}")
    _, points = ground.free()
    doors = costmaps.topology.connectors_of(place)
    poses = [connector.poses[side] for connector, side in doors]
    passages = [shapely.LineString([p[:2] for p in c.poses]) for c, _ in doors]
    paths = [costmaps.path(place, poses[0], pose) for pose in poses[1:]]
    ways = [shapely.LineString(path) for path in paths if path is not None]
    taken = shapely.union_all(
        [
            *(passage.buffer(DOOR_CLEARANCE) for passage in passages),
            *(way.buffer(WAY_CLEARANCE) for way in ways),
        ]
    )
    points = points[~shapely.contains_xy(taken, *points.T)]
    if not len(points):
        raise NoBasePoseError(
            f"{costmaps.robot.name} finds no free floor in {place} apart from its doors and ways"
        )
    start = np.array(poses[0][:2]) if poses else points.mean(axis=0)
    x, y = points[int(np.argmin(np.linalg.norm(points - start, axis=1)))]
    spot = Pose.planar(float(x), float(y), 0.0, costmaps.topology.places[place].floor)
    outline = shapely.Point(x, y).buffer(0.05)
    return LocatedEntity(f"the floor of {place}", "object", place, spot, outline)
