"""The occupancy grid of a storey: what stands in the way, in an interval of heights.

Deeken et al., section 4.2: what of the meshes lies in the interval is occupied, whatever else is in
a room is free. A blocked region is occupied as a whole. For the layered costmap of a robot see
`navgrid.costmap`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from navgrid.area import area_cells
from navgrid.grid import Grid
from navgrid.occupancy import occupancy, slices
from semmap.draw.view import StoreyView
from semmap.geometry.mesh import Mesh, join

__all__ = ["StoreyGrid", "heights", "storey_grid"]

FREE, OCCUPIED, UNKNOWN = 0, 100, -1

IRRELEVANT = {"floor", "ceiling", "roof", "ground", "carpet", "agent"}
"""What one drives on or under, and what moves by itself."""

_MARGIN = 0.25
_PLANES_AT_ONCE = 8


@dataclass(frozen=True, eq=False)
class StoreyGrid:
    """The grid of a storey: int8 cells, row 0 the lowest y: 0 free, 100 occupied, -1 unknown."""

    storey: StoreyView
    grid: Grid
    cells: NDArray[np.int8]


def heights(interval: tuple[float, float], increment: float) -> list[float]:
    """The planes of a closed interval, both ends among them, at most `increment` apart, metres.

    Examples
    --------
    >>> heights((0.0, 0.25), 0.1)
    [0.0, 0.1, 0.2, 0.25]
    """
    low, high = interval
    if not (math.isfinite(low) and math.isfinite(high) and low <= high):
        raise ValueError(f"the interval is {low} to {high} m; give its lower end first")
    if not (math.isfinite(increment) and increment > 0):
        raise ValueError(f"the increment is {increment} m; give one above zero")
    count = math.floor((high - low) / increment + 1e-9)
    planes = [low + i * increment for i in range(count + 1)]
    return planes if math.isclose(planes[-1], high, abs_tol=1e-9) else [*planes, high]


def storey_grid(
    storey: StoreyView,
    interval: tuple[float, float] = (0.05, 1.8),
    resolution: float = 0.05,
    *,
    increment: float | None = None,
    free_outside: bool = False,
) -> StoreyGrid:
    """The grid of a storey.

    Parameters
    ----------
    interval : closed, metres above the storey's floor
    increment
        Metres between planes that cut the meshes, as the paper has it; they miss what lies between.
        By default nothing is sampled, and the inside of closed meshes is occupied, too.
    free_outside
        Leave free what lies neither in a room nor in a doorway. By default it is unknown, in maps
        that have rooms.

    Raises
    ------
    ValueError
        The storey has neither rooms nor anything that stands in the way; an interval that holds
        the floor.
    """
    planes = heights(interval, increment or interval[1] - interval[0] or 1.0)
    if interval[0] <= 0 <= interval[1]:
        raise ValueError(
            f"the interval from {interval[0]:g} to {interval[1]:g} m holds the floor, which would "
            "be occupied as a whole; begin above it, as at 0.05 m"
        )
    low, high = (storey.elevation + end for end in interval)
    meshes = [m for m in _relevant(storey) if _reaches(m, low, high)]
    blocked = [r.outline for r in storey.regions if r.blocked]
    grid = _around(storey, meshes, blocked, resolution)
    if increment is None:
        occupied = _slab(meshes, (low, high), grid)
    else:
        occupied = _sections(meshes, [storey.elevation + h for h in planes], grid)
    for outline in blocked:
        occupied |= covered(outline, grid)
    cells = np.where(occupied, OCCUPIED, FREE).astype(np.int8)
    if storey.rooms and not free_outside:
        known = shapely.union_all([r.outline for r in storey.rooms] + list(_doorways(storey)))
        cells[~occupied & ~covered(known, grid)] = UNKNOWN
    return StoreyGrid(storey, grid, cells)


def covered(outline: shapely.Geometry, grid: Grid) -> NDArray[np.bool_]:
    """(rows, columns) bool: the cells that a polygon meets."""
    return area_cells(outline, grid)


def _relevant(storey: StoreyView) -> Iterable[Mesh]:
    """What stands in a robot's way: objects but floors and the like, and doors that are shut."""
    for thing in storey.objects:
        if thing.mesh is not None and not IRRELEVANT & set(thing.types):
            yield thing.mesh
    for door in storey.doors:
        if door.mesh is not None and door.state != "open":
            yield door.mesh


def _reaches(mesh: Mesh, low: float, high: float) -> bool:
    z = mesh.vertices[:, 2]
    return len(mesh.faces) > 0 and float(z.min()) <= high and float(z.max()) >= low


def _around(
    storey: StoreyView,
    meshes: Sequence[Mesh],
    blocked: Sequence[shapely.Geometry],
    resolution: float,
) -> Grid:
    boxes = [np.array(g.bounds) for g in (*(r.outline for r in storey.rooms), *blocked)]
    boxes += [m.bounds[:, :2].reshape(-1) for m in meshes]
    if not boxes:
        raise ValueError(
            f"storey {storey.name} has neither rooms nor anything that stands in the way; "
            "import walls, furniture or rooms"
        )
    every = np.array(boxes)
    low, high = every[:, :2].min(axis=0) - _MARGIN, every[:, 2:].max(axis=0) + _MARGIN
    return Grid.around((float(low[0]), float(low[1])), (float(high[0]), float(high[1])), resolution)


def _slab(meshes: Sequence[Mesh], interval: tuple[float, float], grid: Grid) -> NDArray[np.bool_]:
    if not meshes:
        return np.zeros(grid.shape, np.bool_)
    whole = join(list(meshes))
    solid = np.repeat(np.arange(len(meshes)), [len(m.faces) for m in meshes])
    cells: NDArray[np.bool_] = occupancy(
        (whole.vertices, whole.faces), [interval], grid, solid=solid, fill=True
    )[0]
    return cells


def _sections(meshes: Sequence[Mesh], planes: Sequence[float], grid: Grid) -> NDArray[np.bool_]:
    occupied = np.zeros(grid.shape, bool)
    if not meshes:
        return occupied
    whole = join(list(meshes))
    for i in range(0, len(planes), _PLANES_AT_ONCE):
        part = slices((whole.vertices, whole.faces), planes[i : i + _PLANES_AT_ONCE], grid)
        occupied |= part.any(axis=0)
    return occupied


def _doorways(storey: StoreyView) -> Iterable[shapely.Geometry]:
    """The floor between the poses before and behind each connector, as wide as it is."""
    for door in storey.doors:
        a, b = ((p.x, p.y) for p in door.poses)
        if a != b:
            yield shapely.LineString([a, b]).buffer((door.width or 0.9) / 2, cap_style="flat")
