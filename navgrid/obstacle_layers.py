"""The cells that entities occupy, by layer and by interval of heights above the floor.

Both the occupancy grid of a storey and the costmap of a robot are made from these cells, so that
the two agree.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from navgrid.grid import Grid
from navgrid.layer_members import LayerChange, LayerMembers
from navgrid.slabs import area_cells, mesh_of, occupancy
from navgrid.terrain import FloorLevel, floor_levels
from navgrid.voxel_cells import voxel_cells, voxels_over
from navgrid.window import Window, whole
from semmap.geometry.voxels import Voxels
from semmap.query.storey_scene import SceneEntity

Interval = tuple[float, float]
"""Closed, metres above the floor."""

ROUNDING = 1e-9
"""Metres by which a border of voxels may miss an end of an interval."""


class ObstacleLayers:
    """The occupied cells of each layer on a grid, at heights above the floor of each cell.

    That floor is that of the room or ramp it lies in. `unknown` (rows, columns) has the cells
    outside of every room and doorway, `levels` the heights of the floor.
    """

    def __init__(self, members: LayerMembers, grid: Grid, *, threads: int | None = None) -> None:
        self.members = members
        self.grid = grid
        self._threads = threads
        self.unknown: NDArray[np.bool_] = np.zeros(grid.shape, np.bool_)
        self.levels: list[FloorLevel] = []
        self._find_floor()

    def _find_floor(self) -> None:
        scene = self.members.scene
        if scene.floors:
            self.unknown = ~area_cells([area.outline for area in scene.floors], self.grid)
        self.levels = floor_levels(
            scene.floors, self.members.ramps, scene.elevation, self.members.limits, self.grid
        )

    def cells(
        self, layer: str, intervals: Sequence[Interval], window: Window | None = None
    ) -> NDArray[np.bool_]:
        """Return the cells of a window that a layer occupies: (intervals, rows, columns) bool.

        Intervals are metres above the floor. A region on the layer is occupied in all of them.
        """
        members = self.members.layers[layer]
        chosen = members.values() if window is None else self._near(members.values(), window)
        return self._cells(chosen, intervals, window or whole(self.grid))

    def areas(self, layer: str) -> NDArray[np.bool_]:
        """Return the (rows, columns) bool cells of a layer's regions, occupied at any height."""
        return self._areas(self.members.layers[layer].values(), whole(self.grid))

    def solids(self, intervals: Sequence[Interval], *, fill: bool = True) -> NDArray[np.bool_]:
        """Return the (intervals, rows, columns) bool cells that meshes and voxels occupy.

        Without areas of regions; `fill` counts the inside of closed meshes. Intervals are metres
        above the floor; (h, h) is the plane at h.
        """
        entities, window = self.members.obstacles(), whole(self.grid)
        found = self._slabs(_solids(entities), intervals, window, fill=fill)
        return found | self._voxels(entities, intervals, window, fill=fill)

    def occupants(
        self, layer: str, interval: Interval, cells: NDArray[np.int64]
    ) -> list[tuple[SceneEntity, int]]:
        """Return the entities of a layer that occupy some (n, 2) cells, and how many of them.

        The interval is in metres above the floor.
        """
        (r0, c0), (r1, c1) = cells.min(axis=0), cells.max(axis=0)
        window = (slice(int(r0), int(r1) + 1), slice(int(c0), int(c1) + 1))
        at = tuple((cells - (r0, c0)).T)
        counts = [
            (entity, int(self._cells([entity], [interval], window)[0][at].sum()))
            for entity in self._near(self.members.layers[layer].values(), window)
        ]
        return [(entity, count) for entity, count in counts if count]

    def update(self, entities: Iterable[SceneEntity], gone: Iterable[int] = ()) -> LayerChange:
        """Replace or add entities and remove those that are gone; return what this changed."""
        change = self.members.update(entities, gone)
        if change.floors:
            self.members.sort()
            self._find_floor()
        return change

    def _near(self, entities: Iterable[SceneEntity], window: Window) -> list[SceneEntity]:
        """Those of the entities that may meet cells of a window."""
        rows, columns = window
        x0, y0, x1, y1 = (
            origin + at * self.grid.resolution
            for origin, at in (
                (self.grid.origin[0], columns.start - 1),
                (self.grid.origin[1], rows.start - 1),
                (self.grid.origin[0], columns.stop + 1),
                (self.grid.origin[1], rows.stop + 1),
            )
        )
        return [
            entity
            for entity in entities
            if (b := entity.bounds) is not None
            if b[0] <= x1 and x0 <= b[2] and b[1] <= y1 and y0 <= b[3]
        ]

    def _cells(
        self, entities: Collection[SceneEntity], intervals: Sequence[Interval], window: Window
    ) -> NDArray[np.bool_]:
        found = self._slabs(_solids(entities), intervals, window)
        found |= self._voxels(entities, intervals, window)
        found |= self._areas(entities, window)
        return found

    def _areas(self, entities: Iterable[SceneEntity], window: Window) -> NDArray[np.bool_]:
        found = np.zeros(self.unknown[window].shape, np.bool_)
        for entity in entities:
            if entity.kind == "region" and entity.footprint is not None:
                found |= area_cells(entity.footprint, self.grid)[window]
        return found

    def _voxels(
        self,
        entities: Iterable[SceneEntity],
        intervals: Sequence[Interval],
        window: Window,
        *,
        fill: bool = True,
    ) -> NDArray[np.bool_]:
        """(intervals, rows, columns): where voxels are in intervals above each cell's floor.

        Where an interval ends within voxels, the surfaces in them say what is in it; a plane has
        the voxels that it meets.
        """
        found = np.zeros((len(intervals), *self.unknown[window].shape), np.bool_)
        alike: dict[tuple[float, bool], list[NDArray[np.int64]]] = {}
        meshes: dict[float, list[SceneEntity]] = {}
        for entity in entities:
            own = entity.voxels
            if entity.kind == "region" or own is None or not len(own):
                continue
            alike.setdefault((own.size, own.triangles is not None), []).append(own.indices)
            if own.triangles is not None:
                mesh = replace(entity, triangles=own.triangles)
                meshes.setdefault(own.size, []).append(mesh)
        for size, solids in meshes.items():
            found |= self._slabs(solids, intervals, window, fill=fill, size=size)
        for (size, has_mesh), parts in alike.items():
            voxels = Voxels(size, np.concatenate(parts))
            for level in self.levels:
                cells = level.cells[window]
                if not cells.any():
                    continue
                above = voxels
                if len(self.levels) > 1:
                    above = voxels_over(voxels, level.cells, self.grid)
                for number, (low, high) in enumerate(intervals):
                    heights = (level.floor + low - ROUNDING, level.floor + high + ROUNDING)
                    if has_mesh and low < high:
                        first, last = _borders(heights, size)
                        heights = (first + size / 2, last - size / 2)
                    found[number] |= (voxel_cells(above, heights, self.grid)[window] > 0) & cells
        return found

    def _slabs(
        self,
        solids: Sequence[SceneEntity],
        intervals: Sequence[Interval],
        window: Window,
        *,
        fill: bool = True,
        size: float | None = None,
    ) -> NDArray[np.bool_]:
        """(intervals, rows, columns): where solids are in intervals above each cell's floor.

        With the size of voxels, only in the ends of the intervals that have no whole voxel.
        """
        found = np.zeros((len(intervals), *self.unknown[window].shape), np.bool_)
        floors = [level for level in self.levels if level.cells[window].any()]
        if not solids or not floors:
            return found
        triangles = np.concatenate([entity.triangles for entity in solids])
        counts = [len(entity.triangles) for entity in solids]
        heights = [(lv.floor + low, lv.floor + high) for lv in floors for low, high in intervals]
        if size is not None:
            heights = [end for each in heights for end in _ends(each, size)]
        layers = occupancy(
            mesh_of(triangles),
            heights,
            self.grid,
            solid=np.repeat(np.arange(len(solids), dtype=np.int32), counts),
            # The shell of a room encloses air.
            fill=np.array([fill and entity.kind != "room" for entity in solids]),
            threads=self._threads,
        )
        if size is not None:
            layers = layers[::2] | layers[1::2]
        for number, level in enumerate(floors):
            here = layers[number * len(intervals) : (number + 1) * len(intervals), *window]
            found |= here & level.cells[window]
        return found


def _borders(heights: Interval, size: float) -> Interval:
    """The lowest and the highest border of voxels in an interval of heights z."""
    low, high = heights
    return math.ceil(low / size) * size, math.floor(high / size) * size


def _ends(heights: Interval, size: float) -> list[Interval]:
    """The parts of an interval below and above its whole voxels, with the borders of these."""
    low, high = heights
    first, last = _borders((low - ROUNDING, high + ROUNDING), size)
    return [
        (low, max(low, min(high, first + ROUNDING))),
        (min(high, max(low, last - ROUNDING)), high),
    ]


def _solids(entities: Iterable[SceneEntity]) -> list[SceneEntity]:
    return [e for e in entities if e.kind != "region" and len(e.triangles)]
