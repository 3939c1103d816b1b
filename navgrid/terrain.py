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
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely import STRtree, box, contains_properly, polygons, union_all

from navgrid.area import area_cells
from navgrid.grid import Grid
from navgrid.occupancy import occupancy
from navgrid.scene import Place

__all__ = ["Gait", "Level", "drivable", "levels"]

GAP = 0.005
"""Metres between faces of a floor, on the ground, that do not part it."""

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
    ground = np.zeros(len(triangles), np.bool_)
    for floor in floors:
        ground |= (low > floor - gait.ground) & (high < floor + gait.ground)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    gentle = (lengths > 1e-12) & (np.abs(normals[:, 2]) >= math.cos(gait.max_slope) * lengths)
    some = np.flatnonzero(gentle & _within_steps(low, high, gentle, floors, gait.max_step))
    if ground[some].all():
        return ground
    shapes = polygons(triangles[some][:, :, :2])
    one, other = STRtree(shapes).query(shapes, predicate="dwithin", distance=GAP)
    step = np.maximum(low[some[one]], low[some[other]]) - np.minimum(
        high[some[one]], high[some[other]]
    )
    joined = step <= gait.max_step
    graph = coo_array(
        (np.ones(int(joined.sum()), bool), (one[joined], other[joined])), shape=(len(some),) * 2
    )
    part = connected_components(graph, directed=False)[1]
    found = ground
    found[some[np.isin(part, part[ground[some]])]] = True
    return found


def _within_steps(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    gentle: NDArray[np.bool_],
    floors: Sequence[float],
    max_step: float,
) -> NDArray[np.bool_]:
    """(F,): whether gentle faces at heights between lead there from a floor, wherever they lie."""
    tenths = np.rint(np.column_stack([low[gentle], high[gentle]]) * 1e4).astype(np.int64)
    _, one = np.unique(tenths[:, 0] * 2**32 + tenths[:, 1], return_index=True)
    spans = tenths[one] / 1e4
    found = np.zeros(len(low), np.bool_)
    for floor in set(floors):
        bottom, top, grown = floor, floor, True
        while grown:
            near = (spans[:, 0] <= top + max_step) & (spans[:, 1] >= bottom - max_step)
            reach = (
                min(bottom, float(spans[near, 0].min(initial=bottom))),
                max(top, float(spans[near, 1].max(initial=top))),
            )
            grown = reach != (bottom, top)
            bottom, top = reach
        found |= (low >= bottom - 1e-4) & (high <= top + 1e-4)
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
