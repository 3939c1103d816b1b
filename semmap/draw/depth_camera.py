"""A synthetic depth camera: the depth image that a pinhole camera takes of triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.arrays import Floats
from semmap.draw.rasteriser import nearest_triangles


@dataclass(frozen=True, eq=False)
class DepthCamera:
    """A pinhole camera without distortion."""

    size: tuple[int, int]  # (width, height), pixels
    intrinsics: tuple[float, float, float, float]  # fx, fy, cx, cy; a pixel's centre is (0, 0)
    pose: Floats  # (4, 4): the optical frame (x right, y down, z ahead) in the map's frame
    nearest: float = 0.1  # metres ahead, within which nothing is seen

    def project(self, points: Floats) -> Floats:
        """Return (..., 3) of points ahead: pixels from left and top, and 1 / depth."""
        fx, fy, cx, cy = self.intrinsics
        x, y, z = np.moveaxis((points - self.pose[:3, 3]) @ self.pose[:3, :3], -1, 0)
        return np.stack([fx * x / z + cx + 0.5, fy * y / z + cy + 0.5, 1 / z], axis=-1)

    def image(self, triangles: Floats) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return the depth image of triangles (F, 3, 3), and the triangle at each pixel.

        Both sides are seen. Depths are metres, NaN where nothing is seen; there the triangle is -1.
        """
        ahead = (triangles - self.pose[:3, 3]) @ self.pose[:3, 2]
        clipped, of = _clipped(triangles, ahead - self.nearest)
        faces, inverse = nearest_triangles(self, clipped)
        seen = faces >= 0
        depth = np.full(faces.shape, np.nan, np.float32)
        depth[seen] = 1 / inverse[seen]
        faces[seen] = of[faces[seen]]
        return depth, faces


def look_at(eye: ArrayLike, target: ArrayLike) -> Floats:
    """Return the (4, 4) pose of an upright optical frame at `eye` that looks at `target`."""
    ahead = np.subtract(target, eye, dtype=float)
    ahead /= np.linalg.norm(ahead)
    side = (1.0, 0.0, 0.0) if abs(ahead[2]) > 0.999 else (0.0, 0.0, 1.0)
    right = np.cross(ahead, side)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(ahead, right), ahead])
    pose[:3, 3] = eye
    return pose


def _clipped(triangles: Floats, inside: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """The parts of triangles with a positive distance `inside` (F, 3), and their triangles."""
    whole = (inside > 0).all(axis=1)
    parts, of = [triangles[whole]], [np.flatnonzero(whole)]
    for face in np.flatnonzero((inside > 0).any(axis=1) & ~whole):
        corners = []
        for i in range(3):
            j = (i + 1) % 3
            a, b = inside[face, i], inside[face, j]
            if a > 0:
                corners.append(triangles[face, i])
            if (a > 0) != (b > 0):
                share = a / (a - b)
                edge = triangles[face, j] - triangles[face, i]
                corners.append(triangles[face, i] + share * edge)
        fan = [(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)]
        parts.append(np.array(fan))
        of.append(np.full(len(fan), face))
    return np.concatenate(parts), np.concatenate(of)
