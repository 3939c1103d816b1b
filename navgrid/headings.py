"""The precise form: whether each part's footprint, turned, touches its own layer, cell by cell.

Where the master costmap makes each part a disc (Deeken et al., section 4.3), this turns its real
footprint to each of n headings, after Hornung et al.: a robot slips through where its shape does.
"""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from navgrid.area import area_cells
from navgrid.costmap import Costmap
from navgrid.grid import Grid

__all__ = ["collisions", "footprint_cells", "part_collisions"]


def collisions(costmap: Costmap, headings: int = 16) -> NDArray[np.bool_]:
    """(headings, rows, columns) bool: where a part would touch what is occupied in its interval.

    The robot's origin is in the middle of a cell, its heading is ``2 * pi * i / headings``. What
    lies beyond the grid is free; what is unknown is no collision.
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
    """(headings, rows, columns) bool: where a footprint touches occupied cells.

    Parameters
    ----------
    occupied : (rows, columns)
    footprint : (N, 2) convex polygon around the robot's frame, heading +x, metres

    Raises
    ------
    ValueError
        Less than one heading.
    """
    if headings < 1:
        raise ValueError(f"a robot has 1 heading or more, not {headings}")
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
            # Robot cell r sees row r + k - row; a row of a convex footprint is one run of cells.
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
    """The cells that a turned footprint meets, and the row and column of the robot's own cell."""
    corners = np.asarray(footprint, dtype=np.float64)
    cos, sin = math.cos(heading), math.sin(heading)
    turned = corners @ np.array([[cos, sin], [-sin, cos]])
    reach = math.ceil(float(np.abs(turned).max()) / resolution) + 1
    size = 2 * reach + 1
    low = -(reach + 0.5) * resolution
    cells = area_cells(shapely.Polygon(turned), Grid((low, low), resolution, (size, size)))
    return cells, (reach, reach)
