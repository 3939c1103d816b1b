"""The cells that polygons meet, by the exact rule of `navgrid.slabs`."""

from __future__ import annotations

import mapbox_earcut
import numpy as np
import shapely
from numpy.typing import NDArray

from navgrid.grid import Grid
from navgrid.slabs import occupancy


def area_cells(outline: shapely.Geometry, grid: Grid) -> NDArray[np.bool_]:
    """Return the (rows, columns) bool cells whose half-open square meets polygons, metres."""
    triangles = flat_triangles(outline)
    if not len(triangles):
        return np.zeros(grid.shape, np.bool_)
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    cells: NDArray[np.bool_] = occupancy((triangles.reshape(-1, 3), faces), [(0, 0)], grid)[0]
    return cells


def flat_triangles(outline: shapely.Geometry) -> NDArray[np.float64]:
    """Return the (F, 3, 3) triangles at z = 0 that make up a polygon or several."""
    parts = []
    for polygon in shapely.get_parts(outline):
        if polygon.geom_type != "Polygon" or polygon.is_empty:
            continue
        rings = [shapely.get_coordinates(r)[:-1] for r in (polygon.exterior, *polygon.interiors)]
        corners = np.concatenate(rings)
        ends = np.cumsum([len(r) for r in rings], dtype=np.uint32)
        numbers = mapbox_earcut.triangulate_float64(corners, ends)
        parts.append(np.pad(corners, ((0, 0), (0, 1)))[numbers].reshape(-1, 3, 3))
    return np.concatenate(parts) if parts else np.empty((0, 3, 3))
