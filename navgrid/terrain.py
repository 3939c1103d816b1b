"""The floor that a robot drives on, and its height in each cell.

A robot drives on faces that are not steeper than it climbs and that are connected to the floor of a
room by steps not higher than it takes, such as thresholds and ramps: they are not obstacles.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from shapely import Geometry, box, contains_properly, polygons, union_all

from navgrid.grid import Grid
from navgrid.slabs import area_cells, mesh_of, occupancy
from semmap.geometry.walk import EXACT, GAP, walked_faces
from semmap.query.storey_scene import FloorArea

THINNEST = 0.005
"""Metres of height below which a slope is not divided further."""


@dataclass(frozen=True)
class DriveLimits:
    """The highest step, metres, and the steepest slope, radians, that a robot drives over.

    Raises
    ------
    ValueError
        A limit is negative, not finite, or a slope of a right angle or more.
    """

    max_step: float = 0.02
    max_slope: float = math.radians(6)

    def __post_init__(self) -> None:
        if not (0 <= self.max_step < math.inf and 0 <= self.max_slope < math.pi / 2):
            raise ValueError(
                f"drive limits: a step of {self.max_step} m and a slope of {self.max_slope} rad; "
                "give a step of 0 m or more, and a slope from 0 to less than a right angle"
            )

    @property
    def ground(self) -> float:
        """Metres above the floor that a robot drives over: a step, as exactly as files have it."""
        return self.max_step + EXACT


@dataclass(frozen=True, eq=False)
class FloorLevel:
    """The (rows, columns) bool cells in which the floor reaches up to a height z, metres."""

    floor: float
    cells: NDArray[np.bool_]


def drivable(
    triangles: NDArray[np.float64], floors: Sequence[float], limits: DriveLimits
) -> NDArray[np.bool_]:
    """Return which of the (F, 3, 3) faces of floors and ramps a robot drives on, (F,) bool.

    These are the faces within `max_slope` that are connected by steps of at most `max_step` to one
    of the rooms' floors, of which the heights z are given, and those within a step of one.
    """
    low, high = triangles[:, :, 2].min(axis=1), triangles[:, :, 2].max(axis=1)
    found = walked_faces(triangles, floors, limits.max_step, limits.max_slope)
    for floor in floors:
        found |= (low > floor - limits.ground) & (high < floor + limits.ground)
    return found


def floor_levels(
    areas: Sequence[FloorArea],
    ramps: NDArray[np.float64],
    elevation: float,
    limits: DriveLimits,
    grid: Grid,
) -> list[FloorLevel]:
    """Return the floor's height in each cell, as one level for each height.

    A slope is divided into levels a quarter of a step thick; on it, an obstacle that is up to a
    quarter higher than a step counts as a step. Outside of all rooms and doorways the floor is at
    `elevation`, z in metres. `ramps` are the (F, 3, 3) drivable faces above or below these floors.
    """
    outlines = defaultdict(list)
    for area in areas:
        outlines[area.floor].append(area.outline)
    flat = {floor: area_cells(of_floor, grid) for floor, of_floor in outlines.items()}
    outside = ~np.logical_or.reduce([*flat.values(), np.zeros(grid.shape, np.bool_)])
    flat[elevation] = flat[elevation] | outside if elevation in flat else outside
    if len(ramps):
        covered = _Covered(ramps, grid)
        for floor, cells in flat.items():
            higher = [outline for z in outlines if z > floor for outline in outlines[z]]
            flat[floor] = cells & ~covered.with_floors(higher)
    found = [FloorLevel(floor, cells) for floor, cells in sorted(flat.items()) if cells.any()]
    if len(ramps):
        bottom, top = float(ramps[:, :, 2].min()), float(ramps[:, :, 2].max())
        count = max(1, math.ceil((top - bottom) / max(limits.max_step / 4, THINNEST)))
        edges = [bottom + k * (top - bottom) / count for k in range(count + 1)]
        bands = occupancy(mesh_of(ramps), pairwise(edges), grid)
        found += [FloorLevel(h, c) for h, c in zip(edges[1:], bands, strict=True) if c.any()]
    return found


class _Covered:
    """The cells that lie wholly under triangles, where a floor below is out of reach."""

    def __init__(self, triangles: NDArray[np.float64], grid: Grid) -> None:
        self._ground = union_all(polygons(triangles[:, :, :2])).buffer(GAP)
        self._shape = grid.shape
        self._at = np.nonzero(area_cells(self._ground, grid))
        x, y = (grid.origin[k] + self._at[1 - k] * grid.resolution for k in range(2))
        self._squares = box(x, y, x + grid.resolution, y + grid.resolution)

    def with_floors(self, higher: Sequence[Geometry]) -> NDArray[np.bool_]:
        """(rows, columns): cells under triangles or, at their edge, also under higher floors."""
        inside = np.zeros(self._shape, np.bool_)
        inside[self._at] = contains_properly(union_all([self._ground, *higher]), self._squares)
        return inside
