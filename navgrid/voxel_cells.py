"""The cells of a grid below voxels, by interval of heights: what slabs are for triangles."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navgrid.grid import Grid
from semmap.geometry.voxels import Voxels

_DENSE = 100
"""Places per voxel up to which a table of all places is quicker than sorting."""

SLACK = 1e-9
"""Of a cell: a voxel that only touches the border of a cell is not in it."""


def voxels_between(voxels: Voxels, interval: tuple[float, float]) -> NDArray[np.bool_]:
    """Return which voxels meet a closed interval of heights z, metres: (N,) bool."""
    bottom = voxels.indices[:, 2] * voxels.size
    found: NDArray[np.bool_] = (bottom <= interval[1]) & (bottom + voxels.size >= interval[0])
    return found


def voxels_over(voxels: Voxels, cells: NDArray[np.bool_], grid: Grid) -> Voxels:
    """Return the voxels that may be above (rows, columns) bool cells: over their rectangle."""
    rows, columns = (np.flatnonzero(cells.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return Voxels(voxels.size, voxels.indices[:0])
    first = np.array(grid.origin) + np.array([columns[0], rows[0]]) * grid.resolution
    last = np.array(grid.origin) + np.array([columns[-1] + 1, rows[-1] + 1]) * grid.resolution
    at = voxels.indices[:, :2]
    low, high = np.floor(first / voxels.size) - 1, np.ceil(last / voxels.size) + 1
    return Voxels(voxels.size, voxels.indices[((at >= low) & (at <= high)).all(axis=1)])


def voxel_cells(
    voxels: Voxels,
    interval: tuple[float, float],
    grid: Grid,
    values: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Return for each cell the largest of the voxels' (N,) values above it, by default 1; else 0.

    Voxels count that meet the closed interval of heights z, metres. (rows, columns) float32.
    """
    reached = voxels_between(voxels, interval)
    cells = np.full(grid.shape, -np.inf, np.float32)
    columns, highest = _columns(
        voxels.indices[reached, :2], None if values is None else values[reached]
    )
    # A column of voxels meets a block of cells; one step writes one cell of every block.
    at = (columns * voxels.size - np.array(grid.origin)) / grid.resolution
    first = np.floor(at + SLACK).astype(np.int64)
    last = np.ceil(at + voxels.size / grid.resolution - SLACK).astype(np.int64) - 1
    widest = math.ceil(voxels.size / grid.resolution) + 1
    for i in range(widest):
        for j in range(widest):
            cell = first + np.array([i, j])
            there = ((cell <= last) & (cell >= 0) & (cell < grid.shape[::-1])).all(axis=1)
            np.maximum.at(cells, (cell[there, 1], cell[there, 0]), highest[there])
    return np.where(np.isneginf(cells), 0, cells).astype(np.float32)


def _columns(
    places: NDArray[np.int64], values: NDArray[np.float32] | None
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The different ones of (N, 2) places, and the largest value of each; by default 1."""
    if not len(places):
        return places, np.empty(0, np.float32)
    low = places.min(axis=0)
    shape = places.max(axis=0) - low + 1
    x, y = (places - low).T
    if values is None and shape.prod() <= _DENSE * len(places):
        there = np.zeros(shape, np.bool_)  # no sorting
        there[x, y] = True
        found = np.argwhere(there)
        return found + low, np.ones(len(found), np.float32)
    different, number = np.unique(x * shape[1] + y, return_inverse=True)
    highest = np.full(len(different), -np.inf, np.float32)
    np.maximum.at(highest, number.reshape(-1), np.float32(1) if values is None else values)
    return np.stack(np.divmod(different, shape[1]), axis=1) + low, highest
