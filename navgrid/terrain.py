"""The floor that is not an obstacle: from which height on things are in a robot's way, by cell.

A robot drives on what hangs together with the floor of a room by steps that are not higher than it
takes, and that is not steeper than it climbs: a threshold, a ramp. Slabs are taken relative to that
floor. Its faces are no obstacles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from shapely import box, contains_properly, polygons, union_all

from navgrid.area import area_cells
from navgrid.grid import Grid
from navgrid.occupancy import occupancy
from navgrid.scene import Place
from semmap.geometry.walk import GAP, walked_faces

__all__ = ["Gait", "Level", "drivable", "levels"]

THINNEST = 0.005
"""Metres of height below which a slope is not divided."""


@dataclass(frozen=True)
class Gait:
    """What a robot drives over: the highest step, metres, and the steepest slope, radians."""

    max_step: float = 0.02
    max_slope: float = math.radians(6)

    def __post_init__(self) -> None:
        if not (0 <= self.max_step < math.inf and 0 <= self.max_slope < math.pi / 2):
            raise ValueError(
                f"a step of {self.max_step} m and a slope of {self.max_slope} rad: give 0 m or "
                "more, and 0 to less than a right angle"
            )

    @property
    def ground(self) -> float:
        """Metres within which a face lies in the floor: a step, at least a micrometre."""
        return max(self.max_step, 1e-6)


@dataclass(frozen=True, eq=False)
class Level:
    """Cells whose floor reaches up to z `floor`, metres: (rows, columns) bool."""

    floor: float
    cells: NDArray[np.bool_]


def drivable(
    triangles: NDArray[np.float64], floors: Sequence[float], gait: Gait
) -> NDArray[np.bool_]:
    """(F,): which of the faces of floors, ramps and the like (F, 3, 3) a robot drives on.

    Those that are gentle enough and hang together, by steps of at most `max_step`, with a room's
    floor, of which `floors` are the heights. What lies within a step of such a height is ground.
    """
    low, high = triangles[:, :, 2].min(axis=1), triangles[:, :, 2].max(axis=1)
    found = walked_faces(triangles, floors, gait.max_step, gait.max_slope)
    for floor in floors:
        found |= (low > floor - gait.ground) & (high < floor + gait.ground)
    return found


def levels(
    places: Sequence[Place],
    ramps: NDArray[np.float64],
    elevation: float,
    gait: Gait,
    grid: Grid,
) -> list[Level]:
    """Each cell's floor; where it slopes, as bands of height a quarter of a step thick.

    On a slope a thing that is up to a quarter higher than a step passes for one.

    Parameters
    ----------
    places : their outlines have their floor; what lies outside of all has `elevation`
    ramps : (F, 3, 3) drivable faces that are above or below these floors
    """
    flat: dict[float, NDArray[np.bool_]] = {}
    inside = np.zeros(grid.shape, np.bool_)
    for place in places:
        cells = area_cells(place.outline, grid)
        inside |= cells
        flat[place.floor] = flat[place.floor] | cells if place.floor in flat else cells
    flat[elevation] = flat[elevation] | ~inside if elevation in flat else ~inside
    if len(ramps):
        under = _covered(ramps, grid)
        flat = {floor: cells & ~under for floor, cells in flat.items()}
    found = [Level(floor, cells) for floor, cells in sorted(flat.items()) if cells.any()]
    if len(ramps):
        bottom, top = float(ramps[:, :, 2].min()), float(ramps[:, :, 2].max())
        count = max(1, math.ceil((top - bottom) / max(gait.max_step / 4, THINNEST)))
        edges = [bottom + k * (top - bottom) / count for k in range(count + 1)]
        faces = np.arange(3 * len(ramps)).reshape(-1, 3)
        bands = occupancy((ramps.reshape(-1, 3), faces), pairwise(edges), grid)
        found += [Level(h, c) for h, c in zip(edges[1:], bands, strict=True) if c.any()]
    return found


def _covered(triangles: NDArray[np.float64], grid: Grid) -> NDArray[np.bool_]:
    """The cells that lie wholly under triangles: floor below them is out of reach there."""
    flat = polygons(triangles[:, :, :2])
    whole = union_all(flat).buffer(GAP)
    touched = area_cells(whole, grid)
    rows, columns = np.nonzero(touched)
    x, y = (grid.origin[k] + (columns, rows)[k] * grid.resolution for k in range(2))
    squares = box(x, y, x + grid.resolution, y + grid.resolution)
    inside = np.zeros(grid.shape, np.bool_)
    inside[rows, columns] = contains_properly(whole, squares)
    return inside
