"""What a mesh covers: the corners of its hull, its outline on the ground."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError
from shapely import MultiPolygon, Polygon

from semmap.geometry.mesh import Mesh

__all__ = ["hull_points", "outline", "silhouette"]


def hull_points(mesh: Mesh) -> NDArray[np.float64]:
    """The corners (N, 3) of the mesh's convex hull: its exact extents under any rotation.

    A flat or straight mesh has no volume; all its extreme points in 66 directions do then.
    """
    points = mesh.used if len(mesh.faces) else mesh.vertices
    if len(points) <= 8:
        return points
    try:
        corners: NDArray[np.float64] = points[ConvexHull(points).vertices]
        return corners
    except QhullError:
        return _flat_hull(points)


def _flat_hull(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Hull corners of points that lie in a plane, on a line or in one place."""
    centred = points - points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(centred, full_matrices=False)
    flat = centred @ axes.T
    if sizes[1] > 1e-9 * max(sizes[0], 1e-12):
        try:
            ring: NDArray[np.float64] = points[ConvexHull(flat[:, :2]).vertices]
            return ring
        except QhullError:
            pass
    return points[[flat[:, 0].argmin(), flat[:, 0].argmax()]]


def outline(mesh: Mesh) -> Polygon:
    """The convex hull of the mesh's projection on the xy plane."""
    return shapely.MultiPoint(hull_points(mesh)[:, :2]).convex_hull


def silhouette(mesh: Mesh) -> Polygon | MultiPolygon:
    """The exact union of the projected triangles; for meshes of up to some ten thousand."""
    flat = shapely.polygons(mesh.triangles[:, :, :2])
    return shapely.union_all(flat[shapely.area(flat) > 1e-12])
