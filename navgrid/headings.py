"""Collisions by heading: where a robot's footprint, turned to a heading, meets obstacles.

The master costmap takes each part for a disc (Deeken et al., section 4.3). Here each part has its
exact footprint, turned to each of n headings, after Hornung et al.: a long robot fits lengthwise
through a gap in which its disc does not fit.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from navgrid.area import area_cells
from navgrid.grid import Grid

if TYPE_CHECKING:
    from navgrid.costmap import Costmap

__all__ = ["collisions", "footprint_cells", "part_collisions"]


def collisions(costmap: Costmap, headings: int = 16) -> NDArray[np.bool_]:
    """Return where any part of a robot would collide, by heading.

    Parameters
    ----------
    costmap : Costmap
    headings : int
        Heading i is ``2 * pi * i / headings`` radians.

    Returns
    -------
    (headings, rows, columns) bool
        For the robot's origin in the middle of each cell. Cells beyond the grid and unknown cells
        are not obstacles.

    Raises
    ------
    ValueError
        There is less than one heading.
    """
    found = np.zeros((headings, *costmap.grid.shape), np.bool_)
    for number, part in enumerate(costmap.parts):
        occupied = np.zeros(costmap.grid.shape, np.bool_)
        for cells in costmap.occupied.values():
            occupied |= cells[number]
        found |= part_collisions(occupied, part.footprint, costmap.grid.resolution, headings)
    return found


def part_collisions(
    occupied: NDArray[np.bool_], footprint: ArrayLike, resolution: float, headings: int
) -> NDArray[np.bool_]:
    """Return where a footprint meets occupied cells, by heading.

    Parameters
    ----------
    occupied : (rows, columns) bool
    footprint : (N, 2)
        A convex polygon in the robot's frame, metres; x points ahead.
    resolution : float, metres
    headings : int

    Returns
    -------
    (headings, rows, columns) bool

    Raises
    ------
    ValueError
        There is less than one heading.
    """
    if headings < 1:
        raise ValueError(f"headings is {headings}; give 1 or more")
    rows, columns = occupied.shape
    found = np.zeros((headings, rows, columns), np.bool_)
    sums = np.zeros((rows, columns + 1), np.int32)
    np.cumsum(occupied, axis=1, out=sums[:, 1:])
    for i in range(headings):
        cells, (row, column) = footprint_cells(footprint, 2 * math.pi * i / headings, resolution)
        for k, line in enumerate(cells):
            covered = np.flatnonzero(line)
            if not len(covered):
                continue
            # Line k lies in row r + k - row for a robot in row r. A convex footprint has one run.
            shift = k - row
            seen = slice(max(0, shift), min(rows, rows + shift))
            robot = slice(seen.start - shift, seen.stop - shift)
            first, last = (int(c) - column for c in (covered[0], covered[-1]))
            begin = np.clip(np.arange(columns) + first, 0, columns)
            end = np.clip(np.arange(columns) + last + 1, 0, columns)
            if seen.start < seen.stop:
                found[i, robot] |= sums[seen][:, end] > sums[seen][:, begin]
    return found


def footprint_cells(
    footprint: ArrayLike, heading: float, resolution: float
) -> tuple[NDArray[np.bool_], tuple[int, int]]:
    """Return the cells that a turned footprint meets, and the row and column of the robot's cell.

    Parameters
    ----------
    footprint : (N, 2), metres in the robot's frame
    heading : float, radians
    resolution : float, metres
    """
    corners = np.asarray(footprint, dtype=np.float64)
    cos, sin = math.cos(heading), math.sin(heading)
    turned = corners @ np.array([[cos, sin], [-sin, cos]])
    reach = math.ceil(float(np.abs(turned).max()) / resolution) + 1
    size = 2 * reach + 1
    low = -(reach + 0.5) * resolution
    cells = area_cells(shapely.Polygon(turned), Grid((low, low), resolution, (size, size)))
    return cells, (reach, reach)
