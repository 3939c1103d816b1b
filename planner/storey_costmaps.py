"""The costmaps on which a class of robots drives inside places (Deeken et al., 4.1 and 4.3).

A path leads over the cells of its place and of the doorways of its connectors, whatever their
states: a closed door blocks its passage, not the path to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from typing import Any, NamedTuple, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import label

from navgrid.costmap import Costmap
from navgrid.field_layer import FieldVoxels
from navgrid.grid import Grid, scene_grid
from navgrid.headings import STEP, DriveSpace, drive, drive_space, drive_way, hits
from navgrid.inflation import INSCRIBED, LETHAL, UNKNOWN
from navgrid.slabs import area_cells
from navgrid.window import Window, common, grown, seen_from, window_around
from planner.base_pose import RoomGround
from planner.exchange.visibility_graph import corner_paths
from planner.graph_edges import StraightTravelCost, Travel
from planner.robot_class import RobotClass
from planner.straight_passage import Interval, free_offsets, opening
from planner.topology import OUTSIDE, PlaceConnector, PlaceRegion, Topology
from semmap.geometry.overlay import GRID
from semmap.geometry.pose import Pose
from semmap.query.outline_walls import is_wall
from semmap.query.storey_scene import FloorArea, SceneEntity, StoreyScene

T = TypeVar("T")

SNAP = 0.5
"""Metres within which a pose that is too close to an obstacle counts as the nearest free cell."""

MOST = 10_000
"""Results of measurements that are kept."""

BELOW, TOP = 0.5, 3.0
"""Metres below and above a place's floor within which a field may be on its storey."""


class RoomCostmap:
    """The part of a storey's costmap that a place covers.

    `window` are the rows and columns of the storey's grid that `grid` and `cells` (rows, columns)
    bool cover; the cells are those of the place.
    """

    def __init__(self, outline: shapely.Geometry, grid: Grid) -> None:
        x0, y0, x1, y1 = outline.bounds
        (c0, r0), (c1, r1) = (
            [math.floor((v - o) / grid.resolution) for v, o in zip(at, grid.origin, strict=True)]
            for at in ((x0, y0), (x1, y1))
        )
        rows, columns = grid.shape
        r0, c0 = (min(max(v, 0), size - 1) for v, size in ((r0, rows), (c0, columns)))
        r1, c1 = (min(max(v, a), size - 1) for v, a, size in ((r1, r0, rows), (c1, c0, columns)))
        self.window: Window = (slice(r0, r1 + 1), slice(c0, c1 + 1))
        origin = (grid.origin[0] + c0 * grid.resolution, grid.origin[1] + r0 * grid.resolution)
        self.grid = Grid(origin, grid.resolution, (r1 - r0 + 1, c1 - c0 + 1))
        self.cells = area_cells(outline, self.grid)


class DoorSide(NamedTuple):
    """One side of a door: its free `parts`, numbered from 1 (rows, columns).

    `gaps` are the part at each point along the opening, 0 where it is not free; `away` is by part
    how far the approach pose is from it, metres, where that is near.
    """

    parts: NDArray[np.int32]
    gaps: list[int]
    away: dict[int, float]


class StoreyWindows(NamedTuple):
    """On which cells of a storey its places and doors depend, (N, 4) ends of rows and columns.

    The shapes in an opening decide whether a door is passed straight, those near its approach poses
    where a robot stands at it.
    """

    places: list[str]
    rooms: NDArray[np.int64]
    doors: list[str]
    openings: NDArray[np.int64]
    approaches: NDArray[np.int64]


class StoreyCostmaps:
    """The costmaps of all storeys of a topology, for one class of robots: a `TravelCost`.

    Each costmap is made when it is needed first. `read_scene` returns the scene of a storey by its
    name, "" in a map that has none. A cell is `resolution` metres. On the most expensive passable
    cells, the robot drives `slow` times slower than on clear ones: 1 doubles the time. `fields`, by
    name, are obstacles and social costs. Places without an outline are crossed straight with
    `straight`, else not. A robot without shape is a ValueError.
    """

    def __init__(
        self,
        topology: Topology,
        robot: RobotClass,
        read_scene: Callable[[str], StoreyScene],
        resolution: float = 0.05,
        slow: float = 1.0,
        fields: Mapping[str, FieldVoxels] | None = None,
        straight: bool = False,
    ) -> None:
        if not robot.parts:
            raise ValueError(
                f"robot {robot.name} has no shape, which its costmaps need; give it a URDF "
                "(semmap robot add)"
            )
        self.topology, self.robot, self.slow = topology, robot, slow
        self.resolution = resolution
        self._storeys = {self.storey_of(place) for place in topology.places if place != OUTSIDE}
        self._read_scene = read_scene
        self.straight = straight
        self._fields = dict(fields or {})
        self._progress: Callable[[str, int], None] | None = None
        self._costmaps: dict[str, Costmap] = {}
        self._rooms: dict[str, RoomCostmap | None] = {}
        self._spaces: dict[str, DriveSpace] = {}
        self._avoided: dict[str, list[PlaceRegion]] = {}
        self._known: dict[tuple[Any, ...], Any] = {}  # measured on the present costs
        self._offsets: dict[str, list[Interval]] = {}  # where doors are passed straight
        self._windows: dict[str, StoreyWindows] = {}

    def report_to(self, progress: Callable[[str, int], None]) -> None:
        """Call `progress` for each new place, with its name and how many places there were."""
        self._progress = progress

    def costmap(self, storey: str) -> Costmap:
        """The costmap of a storey, without its doors, the leaves across them, and agents."""
        if storey not in self._costmaps:
            scene = self._read_scene(storey)
            fixed = tuple(
                e
                for e in scene.entities
                if e.kind not in ("connector", "agent") and not _is_leaf(e)
            )
            self._costmaps[storey] = Costmap(
                replace(scene, entities=fixed),
                self.robot.parts,
                scene_grid(scene, self.resolution),
                limits=self.robot.drive_limits,
                fields=self._fields,
            )
        return self._costmaps[storey]

    def storeys(self) -> list[str]:
        """The storeys whose costmaps are made by now."""
        return [*self._costmaps]

    def is_complete(self) -> bool:
        """Whether the costmaps of all storeys are made by now."""
        return self._storeys <= self._costmaps.keys()

    def complete(self) -> None:
        """Make all costmaps that are not made yet."""
        for place in self.topology.places:
            if place != OUTSIDE:
                self.room(place)

    def storey_of(self, place: str) -> str:
        """The storey of a place; "" in a map that has no storeys."""
        return self.topology.places[place].storey or ""

    def room(self, place: str) -> RoomCostmap | None:
        """The part of the costmap that a place covers; None if the map has no outline of it."""
        if place not in self._rooms:
            if self._progress is not None:
                self._progress(place, len(self._rooms) + 1)
            costmap = self.costmap(self.storey_of(place))
            wanted = {place} | {c.name for c, _ in self.topology.connectors_of(place)}
            outlines = {p.name: p.outline for p in costmap.scene.floors if p.name in wanted}
            union = shapely.union_all([*outlines.values()], grid_size=GRID)
            self._rooms[place] = RoomCostmap(union, costmap.grid) if place in outlines else None
        return self._rooms[place]

    def has_outline(self, place: str) -> bool:
        """Whether the map has an outline of a place."""
        return self.room(place) is not None

    def costs(self, place: str) -> NDArray[np.uint8] | None:
        """(rows, columns) uint8: the costs in the window of a place, `UNKNOWN` outside of it.

        None if the map has no outline of the place.
        """
        room, storey = self.room(place), self.storey_of(place)
        if room is None:
            return None
        costs: NDArray[np.uint8] = self.costmap(storey).master[room.window].copy()
        costs[~room.cells] = UNKNOWN
        for region in self._avoided.get(storey, ()):
            costs[area_cells(region.outline, room.grid)] = UNKNOWN
        return costs

    def space(self, place: str) -> DriveSpace | None:
        """Where the robot fits and moves in a place, by heading; None without an outline."""
        room = self.room(place)
        if room is not None and place not in self._spaces:
            self._spaces[place] = drive_space(self.costmap(self.storey_of(place)), room.window)
        return self._spaces.get(place)

    def ground(self, place: str) -> RoomGround | None:
        """Where the base can stand in a place; None if the map has no outline of it."""
        room, costs = self.room(place), self.costs(place)
        if room is None or costs is None:
            return None
        costmap = self.costmap(self.storey_of(place))
        own = _outline(costmap.scene.floors, place)
        costs[~area_cells(own, room.grid)] = UNKNOWN  # nothing is taken from a doorway
        return RoomGround(
            place,
            self.robot,
            costmap,
            room.window,
            room.grid,
            costs,
            self.topology.places[place].floor,
            tuple(c.leaf() for c, _ in self.topology.connectors_of(place) if c.metres > 0),
        )

    @contextmanager
    def also_avoiding(self, regions: Mapping[str, Sequence[PlaceRegion]]) -> Iterator[None]:
        """Keep paths out of regions, given by storey, inside a ``with`` block."""
        before, known = self._avoided, self._known
        self._avoided = before | {s: [*before.get(s, ()), *more] for s, more in regions.items()}
        self._known = {} if regions else known
        try:
            yield
        finally:
            self._avoided, self._known = before, known

    def _once(self, measure: Callable[..., T], *ends: Any) -> T:
        """What a method measures, once for the present costs; the last `MOST` are kept."""
        key, kept = (measure.__name__, *ends), self._known  # which a change replaces
        if key not in kept:
            found = measure(*ends)
            while len(kept) >= MOST:
                kept.pop(next(iter(kept)), None)
            kept[key] = found
        known: T = kept[key]
        return known

    def between(self, place: str, a: Sequence[Pose], b: Sequence[Pose]) -> Travel:
        """The travel from each of n poses in a place to each of m; infinite without a path."""
        return self._once(self._between, place, (*a,), (*b,))

    def _between(self, place: str, a: Sequence[Pose], b: Sequence[Pose]) -> Travel:
        seconds = np.full((len(a), len(b)), math.inf)
        metres = seconds.copy()
        costs, room, space = self.costs(place), self.room(place), self.space(place)
        if costs is None or room is None or space is None:
            if self.straight:
                return StraightTravelCost(self.robot.speed).between(place, a, b)
            return Travel(seconds, metres)
        ends = [self._ends(place, costs, room.grid, poses) for poses in (a, b)]
        rows, columns = ([i for i, end in enumerate(e) if end is not None] for e in ends)
        if rows and columns:
            cells, targets = (np.array([e[0] for e in k if e is not None]) for k in ends)
            from_pose, to_pose = (np.array([e[1] for e in k if e is not None]) for k in ends)
            others = None if a == b else targets
            price, length = drive(costs, space, self.resolution, cells, others, slow=self.slow)
            aside = from_pose[:, None] + to_pose[None, :]
            seconds[np.ix_(rows, columns)] = (price + aside) / self.robot.speed
            metres[np.ix_(rows, columns)] = length + aside
        seconds.flags.writeable = metres.flags.writeable = False  # it is kept
        return Travel(seconds, metres)

    def path(self, place: str, a: Pose, b: Pose) -> NDArray[np.float64] | None:
        """(N, 2) points of the path from pose to pose in a place, metres; None without a path."""
        costs, room, space = self.costs(place), self.room(place), self.space(place)
        if costs is None or room is None or space is None:
            return None
        ends = self._ends(place, costs, room.grid, (a, b))
        if ends[0] is None or ends[1] is None:
            return None
        found = drive_way(costs, space, self.resolution, ends[0][0], ends[1][0], slow=self.slow)
        if found is None:
            return None
        points = np.array(room.grid.origin) + (found[:, 1::-1] + 0.5) * self.resolution
        return np.concatenate([[[a.x, a.y]], points, [[b.x, b.y]]])

    def obstruction(self, place: str, pose: Pose) -> str | None:
        """What stands in the door of an approach pose, and is not passed aside; else None."""
        return self._once(self._obstruction, place, pose)

    def _obstruction(self, place: str, pose: Pose) -> str | None:
        costs, room, door = self.costs(place), self.room(place), self._doors(place).get(pose)
        if costs is None or room is None or door is None:
            return None
        if (large := self.robot.too_large_for(door)) is not None:
            return large
        joined = self._joined(door, pose)
        if joined is None:
            return None
        floor = self._once(self._standing_room, place)
        end = _nearest(floor & joined, room.grid, pose)
        if end is not None and (
            OUTSIDE in door.places or self._once(self._bends, door.name) is not None
        ):
            return None
        costmap = self.costmap(self.storey_of(place))
        middle = door.leaf().interpolate(0.5, normalized=True)
        spots = (Pose(middle.x, middle.y), pose)
        names = [n for spot in spots for n in _entities_at(costmap, spot, INSCRIBED)]
        what = ", ".join(dict.fromkeys(names)) or "something"
        return f"{what} leaves {self.robot.name} no way through {door.name}"

    def standing(self, place: str, pose: Pose) -> Pose:
        """Where the robot stands for an approach pose, facing the connector.

        It is the pose, or the middle of the cell that ways in `between` begin at in its place; the
        pose, too, where there is none.
        """
        return self._once(self._standing, place, pose)

    def _standing(self, place: str, pose: Pose) -> Pose:
        costs, room = self.costs(place), self.room(place)
        if costs is None or room is None:
            return pose
        (end,) = self._ends(place, costs, room.grid, [pose])
        if end is None or end[1] == 0:
            return pose
        (row, column), _ = end
        (left, low), size = room.grid.origin, room.grid.resolution
        x, y = left + (column + 0.5) * size, low + (row + 0.5) * size
        turn = 0.0
        for connector, side in self.topology.connectors_of(place):
            if connector.poses[side] == pose and connector.metres > 0:
                middle = connector.way.interpolate(0.5, normalized=True)
                before, now = (
                    math.atan2(middle.y - b, middle.x - a) for a, b in (pose[:2], (x, y))
                )
                turn = now - before
        return Pose.planar(x, y, turn, pose.z) @ pose._replace(x=0.0, y=0.0, z=0.0)

    def bends(self, connector: PlaceConnector) -> list[tuple[float, float]]:
        """Where the way through a door bends, as something stands in its opening.

        It leads from where the robot stands in the first place to where it does in the second, over
        the cell of the opening that makes it shortest, or straight over a gap that is too narrow
        for cells. It is straight where nothing is in the way.
        """
        if connector.climbs:
            return self._aside(connector)
        if OUTSIDE in connector.places:
            return []
        return self._once(self._bends, connector.name) or []

    def _aside(self, way: PlaceConnector) -> list[tuple[float, float]]:
        """Where the way over stairs or a ramp bends, past the objects on it; none if it is shut."""
        if way.narrowed is None or self.robot.too_wide_for_the_rest(way) is not None:
            return []
        width = max(float(np.ptp(part.footprint[:, 1])) for part in self.robot.parts)
        ends = np.array([pose[:2] for pose in way.poses])
        found = corner_paths(way.narrowed.free, ends, (width / 2,))
        return [(x, y) for x, y in found.corners[found.between.get((0, 1), [])].tolist()]

    def _bends(self, name: str) -> list[tuple[float, float]] | None:
        connector = self.topology.connectors[name]
        stands = [
            self.standing(*end) for end in zip(connector.places, connector.poses, strict=True)
        ]
        costmap = self.costmap(self.storey_of(connector.places[0]))
        straight = shapely.LineString([pose[:2] for pose in stands])
        aside = [stand[:2] for stand in stands] != [pose[:2] for pose in connector.poses]
        if _are_free(costmap, straight) or (self._once(self._is_clear, name) and not aside):
            return []
        spots = [[at, at] for at in _across(costmap, connector) if _are_free(costmap, at)]
        spots.sort(key=lambda at: sum(at[0].distance(shapely.Point(p[:2])) for p in stands))
        lane: list[shapely.Point] | None = self._once(self._lane, name)
        for ends in [*spots, *([] if lane is None else [lane])]:
            ways = [
                self.path(place, pose, Pose(end.x, end.y))
                for place, pose, end in zip(connector.places, stands, ends, strict=True)
            ]
            if ways[0] is not None and ways[1] is not None:
                one, two = (
                    shapely.LineString(way).simplify(self.resolution / 2).coords[1:] for way in ways
                )
                return [*dict.fromkeys([*one, *two[::-1]])]
        return None

    def _lane(self, name: str) -> list[shapely.Point] | None:
        """The ends, on free cells of both places, of a straight way through an opening.

        The shapes of what stands there leave it room, though cells may not; None without one.
        """
        door = self.topology.connectors[name]
        (a, b), middle = door.poses, door.way.interpolate(0.5, normalized=True)
        x, y = (b.x - a.x) / door.metres, (b.y - a.y) / door.metres
        for low, high in self._free_offsets(door):
            for left in (min(max(low, 0.0), high), (low + high) / 2):
                at = shapely.Point(middle.x - left * y, middle.y + left * x)
                reaches = np.array([-1, 1]) * door.way.length / 2
                ends = [
                    self._first_free(place, at, shapely.Point(at.x + d * x, at.y + d * y))
                    for place, d in zip(door.places, reaches.tolist(), strict=True)
                ]
                if ends[0] is not None and ends[1] is not None:
                    return [ends[0], ends[1]]
        return None

    def _first_free(
        self, place: str, start: shapely.Point, end: shapely.Point
    ) -> shapely.Point | None:
        """The first point from a start to an end in a free cell of a place; outside, the end."""
        room, costs = (None, None) if place == OUTSIDE else (self.room(place), self.costs(place))
        if room is None or costs is None:
            return end
        line = shapely.LineString([start, end])
        steps = np.linspace(0.0, 1.0, 2 + math.ceil(2 * line.length / self.resolution))
        points = line.interpolate(steps, normalized=True)
        free = _values(costs, room.grid, shapely.get_coordinates(points)) < INSCRIBED
        return points[int(np.argmax(free))] if free.any() else None

    def _is_clear(self, name: str) -> bool:
        """Whether the robot drives straight from one approach pose of a door to the other."""
        door = self.topology.connectors[name]
        if self.robot.too_large_for(door) is not None:
            return False
        for place, pose in zip(door.places, door.poses, strict=True):
            point = shapely.Point(pose.x, pose.y)
            if self._first_free(place, point, point) is None:
                return False
        return any(low <= 0 <= high for low, high in self._free_offsets(door))

    def _free_offsets(self, door: PlaceConnector) -> list[Interval]:
        """As `free_offsets`; kept until something changes near the door."""
        if door.name not in self._offsets:
            self._offsets[door.name] = free_offsets(self._costmap_of(door), door)
        return self._offsets[door.name]

    def _costmap_of(self, door: PlaceConnector) -> Costmap:
        return self.costmap(self.storey_of(next(p for p in door.places if p != OUTSIDE)))

    def _doors(self, place: str) -> dict[Pose, PlaceConnector]:
        """The doors of a place, by their approach pose in it."""
        return {
            connector.poses[side]: connector
            for connector, side in self.topology.connectors_of(place)
            if connector.type in ("door", "elevator_door") and connector.metres > 0
        }

    def _ends(
        self, place: str, costs: NDArray[np.uint8], grid: Grid, poses: Sequence[Pose]
    ) -> list[tuple[tuple[int, int], float] | None]:
        """For each pose the passable cell nearest to it, and its distance; None if beyond `SNAP`.

        Before a door it is a cell that is joined with the opening: a robot passes aside of what
        stands there, and not through it. In a cabin, where something closes the door, it is any
        cell, for a robot that rides on.
        """
        doors, passable = self._doors(place), costs < INSCRIBED
        return [
            self._once(self._end_at_door, place, pose)
            if pose in doors
            else _nearest(passable, grid, pose)
            for pose in poses
        ]

    def _end_at_door(self, place: str, pose: Pose) -> tuple[tuple[int, int], float] | None:
        costs, room = self.costs(place), self.room(place)
        assert costs is not None
        assert room is not None
        floor = self._once(self._standing_room, place)
        joined = self._joined(self._doors(place)[pose], pose)
        end = _nearest(floor if joined is None else floor & joined, room.grid, pose)
        if end is None and self.topology.places[place].elevator is not None:
            end = _nearest(floor, room.grid, pose)
        return end

    def _standing_room(self, place: str) -> NDArray[np.bool_]:
        """The passable cells of a place where the robot stands at a door.

        The doors of an elevator close before it leaves: in its cabin, the robot stands where at
        some heading its whole shape is clear of them.
        """
        costs, room, space = self.costs(place), self.room(place), self.space(place)
        assert costs is not None
        assert room is not None
        assert space is not None
        passable = costs < INSCRIBED
        if self.topology.places[place].elevator is None:
            return passable
        costmap = self.costmap(self.storey_of(place))
        own = area_cells(_outline(costmap.scene.floors, place), room.grid)
        leaves = shapely.union_all([door.leaf() for door in self._doors(place).values()])
        shut = area_cells(leaves.buffer(GRID), room.grid) & ~own
        fits = space.fits.copy()
        for part in costmap.parts:
            fits &= ~hits(shut, part.footprint, room.grid.resolution)
        stands: NDArray[np.bool_] = passable & own & (fits != 0)
        return stands

    def _joined(self, door: PlaceConnector, pose: Pose) -> NDArray[np.bool_] | None:
        """The cells of an approach pose's place from which a way leads through the opening.

        None if nothing is in the way from one approach pose to the other.
        """
        sides: tuple[NDArray[np.bool_], ...] | None = self._once(self._sides, door.name)
        return None if sides is None else sides[door.poses.index(pose)]

    def _sides(self, name: str) -> tuple[NDArray[np.bool_], ...] | None:
        """The cells of both places that one gap of an opening joins, by side; see `_joined`.

        Of several gaps it is the one that lies nearest to both approach poses; none, where a thing
        leaves a gap on either side, but not the same one. A gap that is too narrow for cells is
        where shapes leave room for a straight way.
        """
        if self._once(self._is_clear, name):
            return None
        door = self.topology.connectors[name]
        points = shapely.get_coordinates(_across(self._costmap_of(door), door))
        ends = [*zip(door.places, door.poses, strict=True)]
        first, second = (self._side(place, pose, points) for place, pose in ends)
        if self.robot.too_large_for(door) is not None:
            return np.zeros_like(first.parts, np.bool_), np.zeros_like(second.parts, np.bool_)
        reached = _gaps(first, second)
        if not reached and (lane := self._once(self._lane, name)) is not None:
            first, second = (
                self._side(place, pose, shapely.get_coordinates(at))
                for (place, pose), at in zip(ends, lane, strict=True)
            )
            reached = _gaps(first, second)
        best = min(reached, key=lambda ab: first.away[ab[0]] + second.away[ab[1]], default=(-1, -1))
        return first.parts == best[0], second.parts == best[1]

    def _side(self, place: str, pose: Pose, points: NDArray[np.float64]) -> DoorSide:
        """What is free on the side of a door where a place is; all of it, outside or unknown."""
        room = None if place == OUTSIDE else self.room(place)
        costs = None if room is None else self.costs(place)
        if room is None or costs is None:
            return DoorSide(np.zeros((0, 0), np.int32), [1] * len(points), {1: 0.0})
        parts = label(costs < INSCRIBED, np.ones((3, 3)))[0]
        gaps = _values(parts, room.grid, points, 0).tolist()
        floor = self._once(self._standing_room, place)
        ends = {part: _nearest(floor & (parts == part), room.grid, pose) for part in {*gaps}}
        return DoorSide(parts, gaps, {k: end[1] for k, end in ends.items() if end is not None})

    def blocking_reason(self, place: str, pose: Pose, *, measured: bool = False) -> str | None:
        """Why the robot can be neither at a pose of a place nor within `SNAP` of it; else None.

        A pose inside an obstacle is blocked, however near its border is, except a `measured` one:
        by the error of its sensor it may lie there.
        """
        costs, room = self.costs(place), self.room(place)
        if costs is None or room is None:
            return None if self.straight else f"the map has no outline of {place}"
        near = _nearest(costs < INSCRIBED, room.grid, pose)
        storey = self.storey_of(place)
        costmap = self.costmap(storey)
        try:
            row, column = costmap.grid.cell(pose.x, pose.y)
        except ValueError:
            return f"the pose is outside of {place}"
        point = shapely.Point(pose.x, pose.y)
        regions = self._avoided.get(storey, ())
        avoided = [r.name for r in regions if shapely.intersects(r.outline, point)]
        inside = costmap.master[row, column] == LETHAL
        if near is not None and (measured or not (inside or avoided)):
            return None
        if avoided:
            return f"the pose is in {' and '.join(avoided)}, which is to be avoided"
        names = _entities_at(costmap, pose, LETHAL if inside else INSCRIBED)
        if names:
            return f"{', '.join(names)} is in the way"
        return f"the pose is outside of {place}"

    def occupants(self, pose: Pose) -> tuple[str, ...]:
        """The names of the entities at a pose, whether or not it lies in a place."""
        floors = [
            (place.floor, name)
            for name, place in self.topology.places.items()
            if name != OUTSIDE and place.floor <= pose.z + SNAP
        ]
        if not floors:
            return ()
        return _entities_at(self.costmap(self.storey_of(max(floors)[1])), pose, LETHAL)

    def walls_change(self, objects: Iterable[SceneEntity], removed: Collection[int]) -> bool:
        """Whether walls are among changed objects: then rooms gain or lose those of outlines."""
        former = (e for c in self._costmaps.values() for e in c.scene.entities if e.id in removed)
        return any(map(is_wall, chain(objects, former if removed else ())))

    def update(
        self,
        ids: Collection[int],
        objects: Iterable[SceneEntity] = (),
        regions: Mapping[str, Sequence[SceneEntity]] | None = None,
    ) -> set[str]:
        """Apply changes of objects and regions; returns the places whose costs changed.

        `ids` are those of all entities that changed; what is neither in `objects` nor, by storey,
        in `regions` was removed.
        """
        objects, regions = [e for e in objects if not _is_leaf(e)], regions or {}
        changed: set[str] = set()
        for storey, costmap in self._costmaps.items():
            here = [t for t in objects if costmap.scene.reaches(t)]
            here += regions.get(storey, ())
            if not here and not any(number in costmap.obstacles.members for number in ids):
                continue
            before = costmap.master.copy(), costmap.fits.copy()
            window = costmap.update(here, {*ids} - {t.id for t in here})
            if window is not None:
                changed |= self._places_that_differ(storey, before, [window])
        return changed

    def set_fields(self, fields: Mapping[str, FieldVoxels | None]) -> set[str]:
        """Replace or add fields, remove those that are None; returns the places that changed."""
        for name, field in fields.items():
            if field is None:
                self._fields.pop(name, None)
            else:
                self._fields[name] = field
        changed: set[str] = set()
        for storey, costmap in self._costmaps.items():
            before = costmap.master.copy(), costmap.fits.copy()
            windows = [costmap.set_field(name, field) for name, field in fields.items()]
            changed |= self._places_that_differ(
                storey, before, [w for w in windows if w is not None]
            )
        return changed

    def make_costmaps_of(self, fields: Iterable[FieldVoxels]) -> None:
        """Make the costmaps of the storeys that fields reach."""
        for field in fields:
            if (corners := field.voxels.corners) is None:
                continue
            low, high = corners[0][2], corners[1][2]
            for name, place in self.topology.places.items():
                if name != OUTSIDE and place.floor - BELOW <= high and low <= place.floor + TOP:
                    self.costmap(self.storey_of(name))

    def places_near(self, fields: Collection[str]) -> set[str]:
        """The places whose costs may depend on some of the fields, in the costmaps made by now."""
        found = set()
        for storey, costmap in self._costmaps.items():
            windows = [w for name in fields if (w := costmap.field_window(name)) is not None]
            if windows:
                around = self._windows_of(storey)
                found |= {*_among(around.places, around.rooms, windows)}
        return found

    def _places_that_differ(
        self, storey: str, before: tuple[NDArray[Any], NDArray[Any]], windows: Sequence[Window]
    ) -> set[str]:
        """The places of a storey whose costs, or where the robot fits, changed in windows."""
        if not windows:
            return set()
        costmap, around = self.costmap(storey), self._windows_of(storey)
        for name in _among(around.doors, around.openings, windows):
            self._offsets.pop(name, None)
        self._forget(storey, [grown(window, STEP, costmap.grid) for window in windows])
        # at doors, shapes decide, and not cells alone
        doors = _among(around.doors, around.approaches, windows)
        found = {p for name in doors for p in self.topology.connectors[name].places}
        found &= {*around.places}
        for place in {*_among(around.places, around.rooms, windows)} - found:
            room = self.room(place)
            assert room is not None
            master, fits = before[0][room.window], before[1][:, *room.window]
            differs = master != costmap.master[room.window]
            differs |= (fits != costmap.fits[:, *room.window]).any(axis=0)
            if (differs & room.cells).any():
                found.add(place)
        return found

    def _forget(self, storey: str, windows: Sequence[Window]) -> None:
        """Drop what was measured in places and doors of which cells in windows changed.

        What is measured at a door depends on the places on both of its sides.
        """
        costmap, around = self.costmap(storey), self._windows_of(storey)
        near = _among(around.places, around.rooms, windows)
        for place in near:
            self._renew_space(place, costmap, windows)
        doors = {*_among(around.doors, around.approaches, windows)}
        doors |= {door.name for place in near for door, _ in self.topology.connectors_of(place)}
        beside = {p for name in doors for p in self.topology.connectors[name].places}
        stale = {*near, *doors, *beside}
        self._known = {key: found for key, found in self._known.items() if key[1] not in stale}

    def _renew_space(self, place: str, costmap: Costmap, windows: Sequence[Window]) -> None:
        """Compute again, in windows, where the robot fits and moves in a place."""
        space, room = self._spaces.get(place), self.room(place)
        if space is None or room is None:
            return
        renewed = DriveSpace(*(bits.copy() for bits in space))
        for window in windows:
            both = common(window, room.window)
            if both is not None:
                for bits, now in zip(renewed, drive_space(costmap, both), strict=True):
                    bits[seen_from(room.window, both)] = now
        self._spaces[place] = renewed

    def _windows_of(self, storey: str) -> StoreyWindows:
        """The windows of a storey's places and doors."""
        if storey not in self._windows:
            grid = self.costmap(storey).grid
            places = [p for p in self.topology.places if self.storey_of(p) == storey]
            rooms = {p: room for p in places if (room := self.room(p)) is not None}
            doors = {door.name: door for place in rooms for door in self._doors(place).values()}
            self._windows[storey] = StoreyWindows(
                [*rooms],
                _ends_of([room.window for room in rooms.values()]),
                [*doors],
                *(
                    _ends_of([window_around([shape.bounds], grid) for shape in shapes])
                    for shapes in (
                        [opening(door) for door in doors.values()],
                        [door.way.buffer(SNAP) for door in doors.values()],
                    )
                ),
            )
        return self._windows[storey]


def _ends_of(windows: Sequence[Window | None]) -> NDArray[np.int64]:
    """The (N, 4) first row, row after the last, and columns of windows; 0 for None."""
    none = slice(0, 0), slice(0, 0)
    sides = [(r.start, r.stop, c.start, c.stop) for r, c in (w or none for w in windows)]
    return np.array(sides, np.int64).reshape(-1, 4)


def _among(names: Sequence[str], ends: NDArray[np.int64], windows: Sequence[Window]) -> list[str]:
    """The names whose windows overlap some of others."""
    found = np.zeros(len(names), np.bool_)
    for rows, columns in windows:
        found |= (
            (ends[:, 0] < rows.stop)
            & (rows.start < ends[:, 1])
            & (ends[:, 2] < columns.stop)
            & (columns.start < ends[:, 3])
        )
    return [names[k] for k in np.flatnonzero(found).tolist()]


def _nearest(
    passable: NDArray[np.bool_], grid: Grid, pose: Pose
) -> tuple[tuple[int, int], float] | None:
    """The passable cell nearest to a pose, and its distance; None if beyond `SNAP`."""
    at = (np.array([pose.y, pose.x]) - grid.origin[::-1]) / grid.resolution
    row, column = (math.floor(v) for v in at)
    reach = math.ceil(SNAP / grid.resolution)
    r0, c0 = max(0, row - reach), max(0, column - reach)
    window = slice(r0, max(r0, row + reach + 1)), slice(c0, max(c0, column + reach + 1))
    free = np.argwhere(passable[window]) + np.array([r0, c0])
    if (free == (row, column)).all(axis=1).any():
        return (row, column), 0.0
    away = np.linalg.norm(free + 0.5 - at, axis=1) * grid.resolution
    if not len(free) or away.min() > SNAP:
        return None
    r, c = free[int(np.argmin(away))].tolist()
    return (r, c), float(away.min())


def _are_free(costmap: Costmap, line: shapely.Geometry) -> bool:
    """Whether the robot's centre may be at a point, or all along a line."""
    steps = np.linspace(0.0, 1.0, 2 + math.ceil(2 * line.length / costmap.grid.resolution))
    points = shapely.get_coordinates(
        line.interpolate(steps, normalized=True) if line.length else line
    )
    return bool((_values(costmap.master, costmap.grid, points) < INSCRIBED).all())


def _values(
    cells: NDArray[Any], grid: Grid, points: NDArray[np.float64], beyond: int = UNKNOWN
) -> NDArray[Any]:
    """The values of the cells in which points (N, 2) are; `beyond` outside of the grid."""
    at = np.floor((points - grid.origin) / grid.resolution).astype(int)[:, ::-1]
    inside = np.all((at >= 0) & (at < grid.shape), axis=1, keepdims=True)
    return np.where(inside[:, 0], cells[tuple(np.where(inside, at, 0).T)], beyond)


def _across(costmap: Costmap, door: PlaceConnector) -> NDArray[np.object_]:
    """Points across an opening at which the robot is within its posts, whatever its heading."""
    beside = max(part.inscribed_radius for part in costmap.parts)
    leaf = door.leaf(-min(beside, door.leaf().length / 2 - 1e-3))
    steps = np.linspace(0.0, 1.0, 2 + math.ceil(leaf.length / costmap.grid.resolution))
    return np.asarray(leaf.interpolate(steps, normalized=True))


def _gaps(first: DoorSide, second: DoorSide) -> list[tuple[int, int]]:
    """The free parts of both sides of a door that meet, and are near to its approach poses."""
    met = {*zip(first.gaps, second.gaps, strict=True)}
    return [(a, b) for a, b in met if a and b and a in first.away and b in second.away]


def _outline(floors: Iterable[FloorArea], place: str) -> shapely.Geometry:
    """The outline of a place."""
    return shapely.union_all([f.outline for f in floors if f.name == place], grid_size=GRID)


def _is_leaf(entity: SceneEntity) -> bool:
    """Whether it is a leaf across the opening of a door, whose state says whether it is shut."""
    return entity.kind == "object" and entity.state is not None


def _entities_at(costmap: Costmap, pose: Pose, cost: int) -> tuple[str, ...]:
    """The names of the entities that cause at least this cost at a pose."""
    try:
        sources = costmap.explain(pose.x, pose.y)
    except ValueError:
        return ()
    return tuple(dict.fromkeys(n for b in sources if b.cost >= cost for n in b.entities))
