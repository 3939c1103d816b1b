"""A map within an interval of heights as cells of a grid on the floor, for a costmap."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from semmap.fields.maps.lattice import Lattice
from semmap.fields.maps.representation_map import RepresentationMap

__all__ = ["layer_cells"]

_SLACK = 1e-9  # of a cell: a voxel that only touches the border of a cell is not in it


def layer_cells(
    map: RepresentationMap,
    interval: tuple[float, float],
    origin: tuple[float, float],
    resolution: float,
    shape: tuple[int, int],
) -> NDArray[np.float32]:
    """Return for each cell the largest value of the voxels above it.

    Parameters
    ----------
    map : any map
    interval : closed [a, b] in metres in the shared frame; voxels that meet it count
    origin : (x, y) of the lower corner of the grid, metres
    resolution : edge of a cell, metres
    shape : (rows, columns) of the grid; row 0 has the lowest y

    Returns
    -------
    (rows, columns) float32; 0 where there is no voxel. A voxel of a bool map, or of a map with a
    legend, counts as 1
    """
    made = map.resampled(Lattice(map.voxel_size))
    size = map.voxel_size
    ends = (origin[0] + shape[1] * resolution, origin[1] + shape[0] * resolution)
    box = Lattice(size).box((*origin, interval[0]), (*ends, interval[1]))
    voxels, values = made.within(box).read()
    number = map.value_type == "float32" or (map.value_type == "int32" and not map.legend)
    heights = values.astype(np.float32) if number else np.ones(len(values), np.float32)
    bottom = voxels[:, 2] * size
    reached = (bottom <= interval[1]) & (bottom + size >= interval[0])
    columns, column_of = np.unique(voxels[reached, :2], axis=0, return_inverse=True)
    highest = np.full(len(columns), -np.inf, np.float32)
    np.maximum.at(highest, column_of.reshape(-1), heights[reached])
    cells = np.full(shape, -np.inf, np.float32)
    # A column of voxels meets a block of cells; one step writes one cell of every block.
    at = (columns * size - np.array(origin)) / resolution
    first = np.floor(at + _SLACK).astype(int)
    last = np.ceil(at + size / resolution - _SLACK).astype(int) - 1
    widest = math.ceil(size / resolution) + 1
    for i in range(widest):
        for j in range(widest):
            cell = first + np.array([i, j])
            there = ((cell <= last) & (cell >= 0) & (cell < shape[::-1])).all(axis=1)
            np.maximum.at(cells, (cell[there, 1], cell[there, 0]), highest[there])
    return np.where(np.isfinite(cells), cells, 0).astype(np.float32)
