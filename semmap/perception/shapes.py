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
from numpy.typing import NDArray

from semmap.perception.point_cloud import Floats

__all__ = [
    "SHAPES",
    "face_distances",
    "face_normals",
    "face_slopes",
    "size_gradient",
    "size_of",
    "surface",
]

Numbers = NDArray[np.intp]

SHAPES: dict[str, tuple[str, ...]] = {
    "sphere": ("radius",),
    "cylinder": ("radius", "height"),
    "cone": ("radius", "height"),
    "cuboid": ("x", "y", "z"),
}
"""Parameters of the shapes, metres."""


class _Faces(NamedTuple):
    """How the distances to the unbounded faces of a kind of shape are computed.

    Attributes
    ----------
    distances : from points (n, 3) and bounds to (faces, n) metres, positive outside
    normals : from the same and the face of each point to outward normals (n, 3)
    slopes : from the same to the derivatives of those distances by the bounds, (n, bounds)
    """

    distances: Callable[[Floats, Floats], Floats]
    normals: Callable[[Floats, Floats, Numbers], Floats]
    slopes: Callable[[Floats, Floats, Numbers], Floats]


def _sphere_distances(p: Floats, bounds: Floats) -> Floats:
    return np.asarray(np.sqrt(np.einsum("ni,ni->n", p, p)) - bounds[0])[None]


def _sphere_normals(p: Floats, bounds: Floats, own: Numbers) -> Floats:
    return np.asarray(p / np.maximum(np.sqrt(np.einsum("ni,ni->n", p, p)), 1e-12)[:, None])


def _from_axis(p: Floats) -> Floats:
    return np.maximum(np.hypot(p[:, 0], p[:, 1]), 1e-12)


def _cylinder_distances(p: Floats, bounds: Floats) -> Floats:
    radius, low, high = bounds
    return np.stack([_from_axis(p) - radius, low - p[:, 2], p[:, 2] - high])


def _cylinder_normals(p: Floats, bounds: Floats, own: Numbers) -> Floats:
    normal = _CYLINDER_NORMALS[own]
    normal[:, :2] = p[:, :2] * ((own == 0) / _from_axis(p))[:, None]
    return normal


def _cuboid_distances(p: Floats, bounds: Floats) -> Floats:
    return np.concatenate([bounds[:3, None] - p.T, p.T - bounds[3:, None]])


def _cone_distances(p: Floats, bounds: Floats) -> Floats:
    tangent, low, tip = bounds
    cos = 1 / np.sqrt(1 + tangent**2)
    return np.stack([cos * (_from_axis(p) - tangent * (tip - p[:, 2])), low - p[:, 2]])


def _cone_normals(p: Floats, bounds: Floats, own: Numbers) -> Floats:
    cos = 1 / np.sqrt(1 + bounds[0] ** 2)
    normal = np.array([[0, 0, cos * bounds[0]], [0, 0, -1]])[own]
    normal[:, :2] = p[:, :2] * (cos * (own == 0) / _from_axis(p))[:, None]
    return normal


def _cone_slopes(p: Floats, bounds: Floats, own: Numbers) -> Floats:
    tangent, _, tip = bounds
    below = tip - p[:, 2]
    cos = 1 / np.sqrt(1 + tangent**2)
    gap = _from_axis(p) - tangent * below
    slope = np.array([[0, 0, -cos * tangent], [0, 1, 0]])[own]
    slope[:, 0] = (-cos * below - gap * tangent * cos**3) * (own == 0)
    return slope


_CYLINDER_NORMALS = np.array([[0.0, 0, 0], [0, 0, -1], [0, 0, 1]])
_CYLINDER_SLOPES = np.diag([-1.0, 1, -1])
_CUBOID_NORMALS = np.vstack([-np.eye(3), np.eye(3)])
_CUBOID_SLOPES = np.diag([1.0, 1, 1, -1, -1, -1])

_FACES: dict[str, _Faces] = {
    "sphere": _Faces(
        _sphere_distances, _sphere_normals, lambda p, bounds, own: -np.ones((len(p), 1))
    ),
    "cylinder": _Faces(
        _cylinder_distances, _cylinder_normals, lambda p, bounds, own: _CYLINDER_SLOPES[own]
    ),
    "cuboid": _Faces(
        _cuboid_distances,
        lambda p, bounds, own: _CUBOID_NORMALS[own],
        lambda p, bounds, own: _CUBOID_SLOPES[own],
    ),
    "cone": _Faces(_cone_distances, _cone_normals, _cone_slopes),
}


def face_distances(kind: str, points: Floats, bounds: Floats) -> Floats:
    """Return the distances of points (n, 3), in the frame of a shape, to its faces: (faces, n).

    They are metres, positive outside.
    """
    return _FACES[kind].distances(points, bounds)


def face_normals(kind: str, points: Floats, bounds: Floats, face: Numbers) -> Floats:
    """Return the outward normals (n, 3) of the face of each point, (n,) numbers."""
    return _FACES[kind].normals(points, bounds, face)


def face_slopes(kind: str, points: Floats, bounds: Floats, face: Numbers) -> Floats:
    """Return the derivatives of the distance to the face of each point by the bounds, (n, b)."""
    return _FACES[kind].slopes(points, bounds, face)


def surface(kind: str, points: Floats, bounds: Floats) -> tuple[Floats, Floats]:
    """Return the distances of points to the surface, (n,) metres, and its normals, (n, 3)."""
    distances = face_distances(kind, points, bounds)
    nearest = distances.argmax(axis=0)
    normals = face_normals(kind, points, bounds, nearest)
    return np.abs(distances[nearest, np.arange(len(points))]), normals


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
