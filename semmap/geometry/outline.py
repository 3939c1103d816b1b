"""The corners of a mesh's hull, and outlines as they lie."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose

MANY = 2000
"""Most points for which Qhull merges facets; for more points on a circle or plane it is slow."""


def hull_points(mesh: Mesh) -> NDArray[np.float64]:
    """Return the corners (N, 3) of the mesh's convex hull: its extents under any rotation.

    They are exact for up to `MANY` vertices, and to 1e-9 of the mesh's size for more. A mesh of no
    volume has the corners of its hull in its plane, or its two ends. Raises ValueError: a vertex is
    not finite.
    """
    points = mesh.used if len(mesh.faces) else mesh.vertices
    if not np.isfinite(points).all():
        raise ValueError("a mesh with vertices that are not finite has no hull: leave them out")
    if len(points) <= 8:
        return points
    middle = points.min(axis=0) / 2 + points.max(axis=0) / 2
    scale = np.abs(points - middle).max()
    if scale == 0:
        return points[:1]
    at = (points - middle) / scale  # Qhull squares lengths
    if len(points) > MANY:
        chosen = _corners(at, "QJ")  # moves points a little instead of merging facets
        if chosen is not None:
            points, at = points[chosen], at[chosen]
        if len(points) > MANY:
            return points
    chosen = _corners(at)
    return _flat_hull(points, at) if chosen is None else points[chosen]


def _corners(points: NDArray[np.float64], options: str | None = None) -> NDArray[np.intp] | None:
    """Return the numbers of the corners of the hull; None where it has no volume."""
    from scipy.spatial import ConvexHull, QhullError  # slow to load

    try:
        return np.asarray(ConvexHull(points, qhull_options=options).vertices, np.intp)
    except QhullError:
        return None


def _flat_hull(points: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the hull's corners of points in a plane or on a line; `at` are the scaled points."""
    _, sizes, axes = np.linalg.svd(at - at.mean(axis=0), full_matrices=False)
    flat = at @ axes.T
    if sizes[1] > 1e-9 * sizes[0]:
        chosen = _corners(flat[:, :2])
        if chosen is not None:
            return points[chosen]
    return points[[flat[:, 0].argmin(), flat[:, 0].argmax()]]


def placed_outline(area: Polygon | MultiPolygon, pose: Pose) -> Polygon | MultiPolygon:
    """Return an area of a frame's xy plane as it lies, seen from above, when `pose` places it."""
    placed: Polygon | MultiPolygon = shapely.transform(
        area, lambda xy: pose.apply(np.column_stack([xy, np.zeros(len(xy))]))[:, :2]
    )
    return placed
