"""A cloud of a table divided into the table's plane and the clusters of points that stand on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

from semmap.perception.plane import Plane, find_plane
from semmap.perception.point_cloud import Floats, PerceptionError, checked_points, voxel_downsample

FEWEST = 100
"""Finite points that a tabletop needs."""


@dataclass(frozen=True, eq=False)
class Tabletop:
    """A table and what stands on it."""

    plane: Plane  # the table's plane
    surface: Floats  # (n, 3) Points of the table, metres
    clusters: tuple[Floats, ...]  # points (m, 3) of each object, the largest first


def segment_tabletop(
    points: ArrayLike,
    *,
    up: ArrayLike = (0, 0, 1),
    voxel: float = 0.003,
    clearance: float = 0.006,
    height: float = 0.5,
    gap: float = 0.015,
    fewest: int = 40,
    seed: int = 0,
) -> Tabletop:
    """Return the plane of a table, and the clusters of points above it.

    Parameters
    ----------
    points : (n, 3) or (height, width, 3) metres; NaN where the camera saw nothing
    up : (3,) upwards in the frame of the points
    voxel : the cloud is reduced to a point a voxel of this edge, metres
    clearance, height : points are of an object from `clearance` to `height` above the plane, metres
    gap : distance from which on points are of two objects, metres
    fewest : points of a cluster, after the reduction

    Raises
    ------
    PerceptionError
        A cloud of another shape, of fewer than 100 finite points, or without a level plane.
    """
    if not 0 < clearance < height or not 0 < voxel < gap:
        raise PerceptionError(
            f"clearance {clearance}, height {height}, voxel {voxel} and gap {gap}: give "
            "0 < clearance < height and 0 < voxel < gap, metres"
        )
    cloud = voxel_downsample(checked_points(points, FEWEST), voxel)
    plane = find_plane(cloud, up=up, seed=seed)
    above = plane.height(cloud)
    surface = cloud[np.abs(above) < clearance]
    if len(surface) < 3:
        raise PerceptionError(f"fewer than 3 points are within {clearance} m of the table's plane")
    standing = cloud[(above >= clearance) & (above < height)]
    standing = standing[_over(surface, standing, plane, gap)]
    # What hangs in the air, such as a lamp, does not stand on the table.
    reach = clearance + 4 * gap
    clusters = [c for c in clusters_of(standing, gap, fewest) if plane.height(c).min() < reach]
    return Tabletop(plane, surface, tuple(clusters))


def clusters_of(points: Floats, gap: float, fewest: int) -> list[Floats]:
    """Return the `euclidean_clusters` of at least so many points, the largest first."""
    label = euclidean_clusters(points, gap)
    clusters = [points[label == number] for number in range(label.max(initial=-1) + 1)]
    return sorted((c for c in clusters if len(c) >= fewest), key=len, reverse=True)


def euclidean_clusters(points: Floats, gap: float) -> NDArray[np.int32]:
    """Return the cluster (n,) of each point, from 0: chains of points nearer than `gap` metres."""
    if not gap > 0:
        raise PerceptionError(f"the gap is {gap} m: give a number above 0")
    count = len(points)
    if not count:
        return np.zeros(0, np.int32)
    a, b = cKDTree(points).query_pairs(gap, output_type="ndarray").T
    graph = coo_matrix((np.ones(len(a), bool), (a, b)), (count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)


def _over(surface: Floats, points: Floats, plane: Plane, margin: float) -> NDArray[np.bool_]:
    """Whether points are over the convex hull of the table's points, seen along the normal."""
    flat = np.linalg.svd(plane.normal[None])[2][1:].T
    try:
        hull = ConvexHull(surface @ flat)
    except QhullError:
        return np.ones(len(points), bool)
    outside = points @ flat @ hull.equations[:, :2].T + hull.equations[:, 2]
    return np.asarray((outside <= margin).all(axis=1))
