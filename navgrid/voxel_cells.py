"""The cells of a grid below voxels, by interval of heights: what slabs are for triangles."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navgrid.grid import Grid
from semmap.geometry.voxels import Voxels

__all__ = ["voxel_cells", "voxels_between"]

_SLACK = 1e-9  # of a cell: a voxel that only touches the border of a cell is not in it


def voxels_between(voxels: Voxels, interval: tuple[float, float]) -> NDArray[np.bool_]:
    """Return which voxels meet a closed interval of heights z: (N,) bool.

    Parameters
    ----------
    voxels : Voxels
    interval : (low, high), metres
    """
    bottom = voxels.indices[:, 2] * voxels.size
    found: NDArray[np.bool_] = (bottom <= interval[1]) & (bottom + voxels.size >= interval[0])
    return found


def voxel_cells(
    voxels: Voxels,
    interval: tuple[float, float],
    grid: Grid,
    values: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Return for each cell the largest value of the voxels above it.

    Parameters
    ----------
    voxels : Voxels
    interval : (low, high)
        Heights z, metres; closed: voxels that meet it count.
    grid : Grid
    values : (N,) float32, optional
        Of the voxels; by default 1.

    Returns
    -------
    (rows, columns) float32
        0 where there is no voxel.
    """
    reached = voxels_between(voxels, interval)
    cells = np.full(grid.shape, -np.inf, np.float32)
    columns, column_of = np.unique(voxels.indices[reached, :2], axis=0, return_inverse=True)
    highest = np.full(len(columns), -np.inf, np.float32)
    heights = np.float32(1) if values is None else values[reached]
    np.maximum.at(highest, column_of.reshape(-1), heights)
    # A column of voxels meets a block of cells; one step writes one cell of every block.
    at = (columns * voxels.size - np.array(grid.origin)) / grid.resolution
    first = np.floor(at + _SLACK).astype(np.int64)
    last = np.ceil(at + voxels.size / grid.resolution - _SLACK).astype(np.int64) - 1
    widest = math.ceil(voxels.size / grid.resolution) + 1
    for i in range(widest):
        for j in range(widest):
            cell = first + np.array([i, j])
            there = ((cell <= last) & (cell >= 0) & (cell < grid.shape[::-1])).all(axis=1)
            np.maximum.at(cells, (cell[there, 1], cell[there, 0]), highest[there])
    return np.where(np.isneginf(cells), 0, cells).astype(np.float32)
