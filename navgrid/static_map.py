"""A map file, such as one from SLAM, as a layer of a costmap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from navgrid.grid import Grid
from navgrid.map_file import read_map
from navgrid.slabs import occupancy

_LESS = 1e-6  # of a cell: a cell that only touches another does not occupy it


def map_layer(path: Path | str, grid: Grid, threshold: int = 65) -> NDArray[np.bool_]:
    """Return the (rows, columns) bool cells of a grid that occupied cells of a map file overlap.

    Those are occupied that have at least `threshold` percent; unknown cells are not. Raises
    `MapFileError`.
    """
    found, cells = read_map(path)
    return resampled(found, cells >= threshold, grid)


def resampled(source: Grid, occupied: NDArray[np.bool_], grid: Grid) -> NDArray[np.bool_]:
    """Return the (rows, columns) bool cells of `grid` that occupied cells of `source` overlap."""
    rows, columns = np.nonzero(occupied)
    low = np.stack([columns, rows], axis=1) + _LESS
    high = low + 1 - 2 * _LESS
    corners = np.stack(
        [low, np.stack([high[:, 0], low[:, 1]], 1), high, np.stack([low[:, 0], high[:, 1]], 1)],
        axis=1,
    )
    flat = corners * source.resolution + np.array(source.origin)
    vertices = np.pad(flat.reshape(-1, 2), ((0, 0), (0, 1)))
    first = 4 * np.arange(len(rows))[:, None]
    faces = np.concatenate([first + np.array(corner) for corner in ((0, 1, 2), (0, 2, 3))])
    cells: NDArray[np.bool_] = occupancy((vertices, faces), [(0, 0)], grid)[0]
    return cells
