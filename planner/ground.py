"""The costmaps on which a class of robots walks in places (Deeken et al., sections 4.1, 4.3).

A way leads over the cells of its place and the doorways of its connectors, whatever their state: a
door that is shut bars its passage, not the way to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from navgrid.area import area_cells
from navgrid.costmap import Costmap
from navgrid.grid import Grid, scene_grid
from navgrid.inflation import INSCRIBED, LETHAL, UNKNOWN
from navgrid.travel import travel, way
from planner.robot_class import RobotClass
from planner.topology import OUTSIDE, Region, Topology
from planner.walks import Walked
from semmap.geometry.pose import Pose
from semmap.query.storey_scene import SceneEntity, StoreyScene

__all__ = ["Ground", "Room"]

SNAP = 0.5
"""Metres within which a pose that is too close to something is taken to the next free cell."""

Window = tuple[slice, slice]


class Room:
    """The cells of a place: a window of its storey's costmap, and which of it are the place's."""

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


class Ground:
    """The costmaps of the storeys of a topology for a class of robots; made when first asked for.

    Parameters
    ----------
    read : gives the scene of a storey; of "" in a map that has none
    resolution : metres a cell
    slow : how much slower a robot is on the dearest cells that it may pass than on clear ones
    """

    def __init__(
        self,
        topology: Topology,
        robot: RobotClass,
        read: Callable[[str], StoreyScene],
        resolution: float = 0.05,
        slow: float = 1.0,
    ) -> None:
        if not robot.parts:
            raise ValueError(
                f"robot {robot.name} has no shape: a costmap is of its parts; give it a URDF "
                "(semmap robot add)"
            )
        self.topology, self.robot, self.slow = topology, robot, slow
        self.resolution = resolution
        self._read = read
        self._progress: Callable[[str, int], None] | None = None
        self._costmaps: dict[str, Costmap] = {}
        self._rooms: dict[str, Room | None] = {}
        self._avoided: dict[str, list[Region]] = {}

    def tell(self, progress: Callable[[str, int], None]) -> None:
        """Say from now on which place is looked at for the first time, and how many have been."""
        self._progress = progress

    def is_whole(self) -> bool:
        """Whether the costmaps of all storeys are there."""
        return {self.storey_of(p) for p in self.topology.places if p != OUTSIDE} <= {
            *self._costmaps
        }

    # -- costmaps -------------------------------------------------------------------------------

    def costmap(self, storey: str) -> Costmap:
        """The costmap of a storey, without its doors."""
        if storey not in self._costmaps:
            scene = self._read(storey)
            fixed = tuple(e for e in scene.entities if e.kind not in ("connector", "agent"))
            walked = replace(scene, entities=fixed)
            grid = scene_grid(scene, self.resolution)
            self._costmaps[storey] = Costmap(walked, self.robot.parts, grid, limits=self.robot.gait)
        return self._costmaps[storey]

    def storey_of(self, place: str) -> str:
        """The storey of a place; "" in a map that has none."""
        return self.topology.places[place].storey or ""

    def room(self, place: str) -> Room | None:
        """The cells of a place; None where the map knows no outline of it."""
        if place not in self._rooms:
            if self._progress is not None:
                self._progress(place, len(self._rooms) + 1)
            costmap = self.costmap(self.storey_of(place))
            wanted = {place} | {c.name for c, _ in self.topology.doors_of(place)}
            parts = {p.name: p.outline for p in costmap.scene.floors if p.name in wanted}
            whole = shapely.union_all([*parts.values()])
            self._rooms[place] = Room(whole, costmap.grid) if place in parts else None
        return self._rooms[place]

    def costs(self, place: str) -> NDArray[np.uint8] | None:
        """(rows, columns) uint8: the costs in a place's window; unknown where it is not."""
        room, storey = self.room(place), self.storey_of(place)
        if room is None:
            return None
        costs: NDArray[np.uint8] = self.costmap(storey).master[room.window].copy()
        costs[~room.cells] = UNKNOWN
        for region in self._avoided.get(storey, ()):
            costs[area_cells(region.outline, room.grid) & (costs != UNKNOWN)] = LETHAL
        return costs

    def avoid(self, storey: str, regions: Iterable[Region]) -> None:
        """Keep ways out of regions on a storey, instead of those given before."""
        self._avoided[storey] = [*regions]

    def avoided(self, storey: str) -> list[Region]:
        """The regions on a storey that ways are kept out of."""
        return self._avoided.get(storey, [])

    # -- walks ----------------------------------------------------------------------------------

    def between(self, place: str, a: Sequence[Pose], b: Sequence[Pose]) -> Walked:
        """From each of n poses of a place to each of m; inf where no way leads."""
        seconds = np.full((len(a), len(b)), math.inf)
        metres = seconds.copy()
        costs, room = self.costs(place), self.room(place)
        if costs is None or room is None:
            return Walked(seconds, metres)
        ends = [[self._cell(costs, room.grid, pose) for pose in poses] for poses in (a, b)]
        rows, columns = ([i for i, end in enumerate(e) if end is not None] for e in ends)
        if rows and columns:
            cells, targets = (np.array([e[0] for e in k if e is not None]) for k in ends)
            aside, beside = (np.array([e[1] for e in k if e is not None]) for k in ends)
            price, length = travel(
                costs, self.resolution, cells, targets=targets, slow=self.slow, threads=1
            )
            off = aside[:, None] + beside[None, :]
            seconds[np.ix_(rows, columns)] = (price + off) / self.robot.speed
            metres[np.ix_(rows, columns)] = length + off
        return Walked(seconds, metres)

    def path(self, place: str, a: Pose, b: Pose) -> NDArray[np.float64] | None:
        """(N, 2) points of the way from pose to pose, metres; None where there is none."""
        costs, room = self.costs(place), self.room(place)
        if costs is None or room is None:
            return None
        ends = [self._cell(costs, room.grid, pose) for pose in (a, b)]
        if ends[0] is None or ends[1] is None:
            return None
        found = way(costs, self.resolution, ends[0][0], ends[1][0], slow=self.slow)
        if found is None:
            return None
        points = np.array(room.grid.origin) + (found[:, ::-1] + 0.5) * self.resolution
        return np.concatenate([[[a.x, a.y]], points, [[b.x, b.y]]])

    def _cell(
        self, costs: NDArray[np.uint8], grid: Grid, pose: Pose
    ) -> tuple[tuple[int, int], float] | None:
        """The passable cell that is nearest to a pose, and how far that is; None beyond `SNAP`."""
        at = (np.array([pose.y, pose.x]) - grid.origin[::-1]) / grid.resolution
        row, column = (math.floor(v) for v in at)
        inside = 0 <= row < grid.shape[0] and 0 <= column < grid.shape[1]
        if inside and costs[row, column] < INSCRIBED:
            return (row, column), 0.0
        reach = math.ceil(SNAP / grid.resolution)
        r0, c0 = max(0, row - reach), max(0, column - reach)
        near = costs[r0 : max(r0, row + reach + 1), c0 : max(c0, column + reach + 1)]
        free = np.argwhere(near < INSCRIBED)
        if not len(free):
            return None
        away = np.linalg.norm(free + np.array([r0 + 0.5, c0 + 0.5]) - at, axis=1) * grid.resolution
        best = int(np.argmin(away))
        if away[best] > SNAP:
            return None
        return (int(free[best, 0]) + r0, int(free[best, 1]) + c0), float(away[best])

    def hindrance(self, place: str, pose: Pose, *, about: bool = False) -> str | None:
        """Why the robot cannot be at a pose of a place, nor within `SNAP` of it; None if it can.

        Within something it cannot be, however near its border is.

        Parameters
        ----------
        about : the pose is a measured one, and may be within something by mistake
        """
        costs, room = self.costs(place), self.room(place)
        if costs is None or room is None:
            return f"the map does not know what {place} covers"
        near = self._cell(costs, room.grid, pose)
        storey = self.storey_of(place)
        costmap = self.costmap(storey)
        try:
            row, column = costmap.grid.cell(pose.x, pose.y)
        except ValueError:
            return f"that is outside of {place}"
        point = shapely.Point(pose.x, pose.y)
        avoided = [r.name for r in self.avoided(storey) if shapely.intersects(r.outline, point)]
        within = costmap.master[row, column] == LETHAL
        if near is not None and (about or not (within or avoided)):
            return None
        if avoided:
            return f"it is in {' and '.join(avoided)}, which is to be avoided"
        names = _blamed(costmap, pose, LETHAL if within else INSCRIBED)
        return f"{', '.join(names)} is in the way" if names else f"that is outside of {place}"

    def occupants(self, pose: Pose) -> tuple[str, ...]:
        """Which entities are at a pose, whether or not it is in a place."""
        floors = [
            (p.floor, n) for n, p in self.topology.places.items()
            if n != OUTSIDE and p.floor <= pose.z + SNAP
        ]  # fmt: skip
        if not floors:
            return ()
        return _blamed(self.costmap(self.storey_of(max(floors)[1])), pose, LETHAL)

    # -- changes --------------------------------------------------------------------------------

    def storeys(self) -> list[str]:
        """The storeys of which there are costmaps."""
        return [*self._costmaps]

    def update(
        self,
        ids: Collection[int],
        objects: Iterable[SceneEntity] = (),
        regions: Mapping[str, Sequence[SceneEntity]] | None = None,
    ) -> set[str]:
        """Take in objects and regions that moved, came or went; the places whose costs are others.

        Parameters
        ----------
        ids : of all that changed; those that are not among the others are gone
        objects : those of them that are there
        regions : those of them that are on a storey, for each storey that has any
        """
        objects, regions = [*objects], regions or {}
        changed: set[str] = set()
        for storey, costmap in self._costmaps.items():
            here = [t for t in objects if costmap.scene.reaches(t)]
            here += regions.get(storey, ())
            before = costmap.master.copy()
            window = costmap.update(here, {*ids} - {t.id for t in here})
            if window is None:
                continue
            differs = np.zeros(costmap.grid.shape, np.bool_)
            differs[window] = before[window] != costmap.master[window]
            if not differs.any():
                continue
            for place in self.topology.places:
                room = self.room(place) if self.storey_of(place) == storey else None
                if room is not None and (differs[room.window] & room.cells).any():
                    changed.add(place)
        return changed


def _blamed(costmap: Costmap, pose: Pose, cost: int) -> tuple[str, ...]:
    """Which entities make a costmap cost so much or more at a pose."""
    try:
        blames = costmap.explain(pose.x, pose.y)
    except ValueError:
        return ()
    return tuple(dict.fromkeys(n for b in blames if b.cost >= cost for n in b.entities))
