"""The outline of set cells of a grid."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon


def cell_outline(cells: NDArray[np.bool_]) -> MultiPolygon:
    """Return the area of the set cells (rows, columns), x to the right and y up, in cells."""
    cells, lines = np.pad(cells, 1), []
    for grid in (cells, np.ascontiguousarray(cells.T)):
        above, below = grid[1:], grid[:-1]
        for side in (above & ~below, below & ~above):
            # A run along one side of the cells ends wherever the border turns, also in a corner.
            turns = np.flatnonzero(side[:, 1:] != side[:, :-1])
            row, column = np.divmod(turns, side.shape[1] - 1)
            row, start, stop = row[::2], column[::2] + 1, column[1::2] + 1
            at = np.stack([np.stack([start, row + 1], 1), np.stack([stop, row + 1], 1)], 1)
            lines.append(at if grid is cells else at[:, :, ::-1])
    border = shapely.linestrings(np.concatenate(lines).astype(float))
    faces = shapely.get_parts(shapely.polygonize(border))
    column, row = np.floor(shapely.get_coordinates(shapely.point_on_surface(faces))).astype(int).T
    return shapely.transform(shapely.multipolygons(faces[cells[row, column]]), lambda at: at - 1)
