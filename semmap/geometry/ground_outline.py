"""The ground below a mesh: what it covers, seen from above, as it stands or leans."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

import semmap_native
from semmap.geometry.cell_outline import cell_outline
from semmap.geometry.extent import extent
from semmap.geometry.mesh import Mesh
from semmap.geometry.morphology import polygons
from semmap.geometry.outline import placed_outline
from semmap.geometry.pose import Pose

FULL, LEAST = 0.95, 0.01
"""An outline is its hull if it fills this share of it, or lacks less than these square metres."""

FEW = 600
"""Most triangles, upright ones apart, that are united exactly; of more the cells of a grid are."""

CELL, CELLS = 0.002, 1024
"""Least side of a cell of that grid, metres, and most cells along the longer side."""


def silhouette(mesh: Mesh) -> Polygon | MultiPolygon:
    """Return the exact union of the projected triangles; for up to some ten thousand of them."""
    flat = shapely.polygons(mesh.triangles[:, :, :2])
    return shapely.union_all(flat[shapely.area(flat) > 1e-12])


def ground_outline(mesh: Mesh, corners: NDArray[np.float64]) -> MultiPolygon | None:
    """Return the area that a mesh covers seen from above; None where that is its convex hull.

    `corners` (N, 3) are its `hull_points`.

    It is the hull where it fills `FULL` of it or lacks less than `LEAST` square metres, as near as
    a grid tells; holes smaller than that are closed. The area contains the projection of each
    triangle, also of upright ones. Of up to `FEW` triangles it is exact to 1 mm. Of more it reaches
    at most 5 cells further, and not out of the hull: 1 cm, or 5 mm for each metre of a mesh longer
    than 2 m.
    """
    hull = shapely.MultiPoint(corners[:, :2]).convex_hull
    enough = min(FULL * hull.area, hull.area - LEAST)
    if not 0 < enough < np.inf:
        return None
    low, high = extent(corners)
    size = max(CELL, float((high - low)[:2].max()) / CELLS)
    corner = low - (2 * size, 2 * size, 0)
    met = _met_cells(mesh, corner, high, size)
    if (met.sum() + _within(met).sum()) / 2 * size**2 >= enough:
        return None
    flat = mesh.triangles[:, :, :2]
    (ux, uy), (vx, vy) = (np.moveaxis(flat[:, k] - flat[:, 0], 1, 0) for k in (1, 2))
    wide = np.abs(ux * vy - uy * vx) > 2e-12
    if wide.sum() <= FEW:
        area = _exact_outline(shapely.polygons(flat[wide]), shapely.linearrings(flat[~wide]))
    else:
        outline = shapely.transform(cell_outline(met), lambda at: at * size + corner[:2])
        area = outline.simplify(size).buffer(size, join_style="mitre", mitre_limit=2.0)
    parts = [_without_holes(part) for part in polygons(area.intersection(hull))]
    return MultiPolygon(parts) if sum(part.area for part in parts) < enough else None


def _met_cells(
    mesh: Mesh, corner: NDArray[np.float64], high: NDArray[np.float64], size: float
) -> NDArray[np.bool_]:
    """Return which cells of a grid from a corner triangles meet, seen from above; the rim is free.

    The grid is that of the mesh in units of a cell, so that a mesh may have any size.
    """
    columns, rows, top = (int(n) + 2 for n in np.ceil((high - corner) / size))
    vertices = (mesh.vertices - corner) / size
    faces = np.ascontiguousarray(mesh.faces, np.int32)
    found = semmap_native.occupancy(
        vertices, faces, [(-1.0, float(top))], 0.0, 0.0, 1.0, rows, columns, None, 1, False, None, 1
    )
    return np.asarray(found[0])


def _within(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells all of whose neighbours are set; the rim is free."""
    rows = cells[1:-1] & cells[:-2] & cells[2:]
    return rows[:, 1:-1] & rows[:, :-2] & rows[:, 2:]


def _exact_outline(
    flat: NDArray[np.object_], upright: NDArray[np.object_]
) -> Polygon | MultiPolygon:
    """Return the union of projected triangles, with 1 mm around the sides of upright ones."""
    area = shapely.union_all(flat)
    beside = upright[~shapely.covers(area.buffer(1e-6), upright)]
    return shapely.union_all([area, *shapely.buffer(beside, 1e-3)]).simplify(1e-6)


def _without_holes(part: Polygon) -> Polygon:
    """Return a polygon without holes of less than `LEAST`."""
    return Polygon(part.exterior, [h for h in part.interiors if Polygon(h).area >= LEAST])


def leaning_outline(
    area: Polygon | MultiPolygon, hull: NDArray[np.float64], pose: Pose
) -> Polygon | MultiPolygon | None:
    """Return the ground below a model that leans by less than 30 degrees; None if it leans more.

    It is its area at half of its height, grown by what it leans from there to its top and bottom,
    and none of it outside of its hull, whose corners (N, 3) are in the model's frame.
    """
    lean = float(np.linalg.norm(pose.rotation_matrix[:2, 2]))
    if pose.rotation_matrix[2, 2] <= 0 or lean >= 0.5:
        return None
    low, high = hull[:, 2].min(), hull[:, 2].max()
    grown = placed_outline(area, pose @ Pose(z=(low + high) / 2)).buffer(
        lean * (high - low) / 2 + 1e-4,
        join_style="mitre",  # GEOS loses shapes that grow by less
    )
    return MultiPolygon(polygons(grown & shapely.MultiPoint(pose.apply(hull)[:, :2]).convex_hull))
