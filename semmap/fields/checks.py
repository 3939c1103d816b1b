"""Checks of lengths, points and poses that users give."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.geometry.pose import Pose

Vector = tuple[float, float, float]


def positive(value: float, name: str) -> float:
    """Return a length in metres; raise ValueError unless it is finite and above 0."""
    number = float(value)
    if not (math.isfinite(number) and number > 0):
        raise ValueError(f"{name} is {value!r}: give metres above 0")
    return number


def as_length(value: float, name: str) -> float:
    """Return a length in metres; raise ValueError unless it is finite and at least 0."""
    number = float(value)
    if not (math.isfinite(number) and number >= 0):
        raise ValueError(f"{name} is {value!r}: give metres of at least 0")
    return number


def as_vector(value: ArrayLike, name: str) -> Vector:
    """Return three finite numbers as a tuple; raise ValueError for anything else."""
    array = np.asarray(value, dtype=float)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ValueError(f"{name} is {value!r}: give three finite numbers")
    return float(array[0]), float(array[1]), float(array[2])


def as_direction(value: ArrayLike, name: str) -> Vector:
    """Return a vector of any length above 0 as one of length 1; raise ValueError for others."""
    x, y, z = as_vector(value, name)
    length = math.hypot(x, y, z)
    if not 0 < length < math.inf:
        raise ValueError(f"{name} is {value!r}: a direction has a length above 0")
    return x / length, y / length, z / length


def as_rotation(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return the rotation matrix (3, 3) of a unit quaternion (x, y, z, w), or raise ValueError."""
    q = np.asarray(value, dtype=float)
    if q.shape != (4,) or not abs(float(np.linalg.norm(q)) - 1) < 1e-6:
        raise ValueError(f"{name} is {value!r}: give a unit quaternion (x, y, z, w)")
    return Pose(0, 0, 0, *(q / np.linalg.norm(q)).tolist()).rotation_matrix


def as_rigid_rows(value: ArrayLike, name: str) -> list[list[float]]:
    """Return the upper three rows of a rigid transform (4, 4); raise ValueError for others."""
    m = np.asarray(value, dtype=float)
    if m.shape != (4, 4) or not np.isfinite(m).all():
        raise ValueError(f"{name}: give a (4, 4) rigid transform of finite numbers")
    turn = m[:3, :3]
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) or not np.allclose(m[3], (0, 0, 0, 1)):
        raise ValueError(f"{name}: give a (4, 4) rigid transform: a rotation, no scale, no shear")
    rows: list[list[float]] = m[:3].tolist()
    return rows


def as_points(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return finite points (N, 3) as a contiguous array; raise ValueError for others."""
    points = np.ascontiguousarray(value, dtype=np.float64)
    if points.shape == (0,):
        points = points.reshape(0, 3)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{name} has shape {points.shape}: give an (N, 3) array")
    if not np.isfinite(points).all():
        raise ValueError(f"{name} holds NaN or infinity: leave those points out")
    return points


def as_faces(value: ArrayLike, vertices: int, name: str) -> NDArray[np.int32]:
    """Return triangles (M, 3) as contiguous indices of vertices; raise ValueError for others."""
    faces = np.asarray(value)
    if faces.ndim != 2 or faces.shape[1] != 3 or not np.issubdtype(faces.dtype, np.integer):
        raise ValueError(f"{name}: give an (M, 3) array of integers")
    if faces.size and (faces.min() < 0 or faces.max() >= vertices):
        raise ValueError(f"{name}: give vertices 0 to {vertices - 1}, there are no others")
    return np.ascontiguousarray(faces, dtype=np.int32)
