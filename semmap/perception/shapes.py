"""The shapes that can be fitted: their parameters, and the faces of their surfaces.

Each shape is convex, so that the distance of a point to its surface is the largest of the signed
distances to its unbounded faces (planes, a cylinder or cone, a sphere). A fit works on *bounds*,
one number a face, because a view may show one end of a shape and not the other:

========  ==========================================
sphere    radius
cylinder  radius, low z, high z
cuboid    low x, low y, low z, high x, high y, high z
cone      slope (radius / height), low z, z of the tip
========  ==========================================
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from semmap.perception.point_cloud import Floats

__all__ = ["SHAPES", "FaceDistances", "face_distances", "size_gradient", "size_of", "surface"]

SHAPES: dict[str, tuple[str, ...]] = {
    "sphere": ("radius",),
    "cylinder": ("radius", "height"),
    "cone": ("radius", "height"),
    "cuboid": ("x", "y", "z"),
}
"""Parameters of the shapes, metres."""


class FaceDistances(NamedTuple):
    """Distances of n points to the k unbounded faces of a shape with b bounds.

    Attributes
    ----------
    distance : (k, n), metres, positive outside
    normal : (k, n, 3), outward
    slope : (k, n, b)
        Derivatives of the distances by the bounds.
    """

    distance: Floats
    normal: Floats
    slope: Floats


def _sphere(p: Floats, bounds: Floats) -> FaceDistances:
    radius = np.maximum(np.linalg.norm(p, axis=1), 1e-12)
    return FaceDistances(
        (radius - bounds[0])[None], (p / radius[:, None])[None], -np.ones((1, len(p), 1))
    )


def _cylinder(p: Floats, bounds: Floats) -> FaceDistances:
    radius, low, high = bounds
    rho = np.maximum(np.hypot(p[:, 0], p[:, 1]), 1e-12)
    normal = np.zeros((3, len(p), 3))
    normal[0, :, :2] = p[:, :2] / rho[:, None]
    normal[1, :, 2], normal[2, :, 2] = -1, 1
    slope = np.zeros((3, len(p), 3))
    slope[0, :, 0], slope[1, :, 1], slope[2, :, 2] = -1, 1, -1
    return FaceDistances(np.stack([rho - radius, low - p[:, 2], p[:, 2] - high]), normal, slope)


def _cuboid(p: Floats, bounds: Floats) -> FaceDistances:
    low, high = bounds[:3], bounds[3:]
    normal = np.zeros((6, len(p), 3))
    slope = np.zeros((6, len(p), 6))
    for i in range(3):
        normal[i, :, i], normal[3 + i, :, i] = -1, 1
        slope[i, :, i], slope[3 + i, :, 3 + i] = 1, -1
    return FaceDistances(np.concatenate([low - p, p - high], axis=1).T, normal, slope)


def _cone(p: Floats, bounds: Floats) -> FaceDistances:
    tangent, low, tip = bounds
    rho = np.maximum(np.hypot(p[:, 0], p[:, 1]), 1e-12)
    below = tip - p[:, 2]
    cos = 1 / np.sqrt(1 + tangent**2)
    gap = rho - tangent * below
    normal = np.zeros((2, len(p), 3))
    normal[0, :, :2] = cos * p[:, :2] / rho[:, None]
    normal[0, :, 2], normal[1, :, 2] = cos * tangent, -1
    slope = np.zeros((2, len(p), 3))
    slope[0, :, 0] = -cos * below - gap * tangent * cos**3
    slope[0, :, 2], slope[1, :, 1] = -cos * tangent, 1
    return FaceDistances(np.stack([cos * gap, low - p[:, 2]]), normal, slope)


_FACES: dict[str, Callable[[Floats, Floats], FaceDistances]] = {
    "sphere": _sphere,
    "cylinder": _cylinder,
    "cone": _cone,
    "cuboid": _cuboid,
}


def face_distances(kind: str, points: Floats, bounds: Floats) -> FaceDistances:
    """Return the distances of points, in the frame of a shape, to its faces."""
    return _FACES[kind](points, bounds)


def surface(kind: str, points: Floats, bounds: Floats) -> tuple[Floats, Floats]:
    """Return the distances of points to the surface, (n,) metres, and its normals, (n, 3)."""
    faces = face_distances(kind, points, bounds)
    nearest = faces.distance.argmax(axis=0), np.arange(len(points))
    return np.abs(faces.distance[nearest]), faces.normal[nearest]


def size_of(kind: str, bounds: Floats) -> Floats:
    """Return the parameters of `SHAPES` for bounds."""
    if kind == "sphere":
        return bounds
    if kind == "cuboid":
        return bounds[3:] - bounds[:3]
    height = bounds[2] - bounds[1]
    return np.array([bounds[0] * (height if kind == "cone" else 1), height])


def size_gradient(kind: str, bounds: Floats) -> Floats:
    """Return the derivatives of the parameters by the bounds, (parameters, bounds)."""
    if kind == "sphere":
        return np.eye(1)
    if kind == "cuboid":
        return np.hstack([-np.eye(3), np.eye(3)])
    if kind == "cylinder":
        return np.array([[1.0, 0, 0], [0, -1, 1]])
    tangent, low, tip = bounds
    return np.array([[tip - low, -tangent, tangent], [0, -1, 1]])
