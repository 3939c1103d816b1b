"""The convex hull of points, as the native code takes it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FARTHEST = 1e50
"""Metres; products of three such coordinates can still be computed."""


class Polytope(NamedTuple):
    """A convex hull."""

    corners: NDArray[np.float64]  # (C, 3) metres
    # (F, 3) outward unit normals of the facets; two of a flat hull, none of a segment
    normals: NDArray[np.float64]
    edges: NDArray[np.float64]  # (E, 3) directions of the edges


def convex_hull(points: NDArray[np.float64]) -> Polytope:
    """Return the convex hull of (N, 3) points: a polytope, a polygon, a segment or a point.

    Raises ValueError: a coordinate is so large that distances overflow.
    """
    from scipy.spatial import ConvexHull  # slow to load; few commands need it

    far = max(float(np.abs(points).max()), 1e-300)
    if not far < FARTHEST:
        raise ValueError(f"a point of the hull is at {far:.3g} m: give metres in the map's frame")
    middle = points.mean(axis=0)
    spread = np.linalg.svd(points - middle, full_matrices=True)
    lengths = np.zeros(3)
    lengths[: len(spread.S)] = spread.S
    none = np.zeros((0, 3))
    dimension = int((lengths > 1e-12 * far * math.sqrt(len(points))).sum())
    axes = spread.Vh
    if dimension == 0:
        return Polytope(points[:1].copy(), none, none)
    if dimension == 1:
        at = (points - middle) @ axes[0]
        ends = points[[int(at.argmin()), int(at.argmax())]]
        return Polytope(ends, none, axes[:1].copy())
    if dimension == 2:
        ring = points[ConvexHull((points - middle) @ axes[:2].T).vertices]
        normal = np.cross(axes[0], axes[1])
        return Polytope(ring, np.stack([normal, -normal]), np.roll(ring, -1, axis=0) - ring)
    hull = ConvexHull(points - middle)
    normals = np.unique(np.round(hull.equations[:, :3], 12), axis=0)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    corners = points[hull.simplices]
    edges = (corners - np.roll(corners, 1, axis=1)).reshape(-1, 3)
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    edges[edges[:, 0] < 0] *= -1
    edges = np.unique(np.round(edges, 12), axis=0)
    return Polytope(points[hull.vertices], np.ascontiguousarray(normals), edges)
