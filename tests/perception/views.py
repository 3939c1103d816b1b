"""What a depth camera sees of a mesh: the clouds that the tests of perception use."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from semmap.draw.depth_camera import DepthCamera, look_at


def solid(kind: str, size: tuple[float, ...], pose: ArrayLike | None = None) -> trimesh.Trimesh:
    """A shape of trimesh, in the frames of `semmap.perception.primitives.Primitive`."""
    if kind == "sphere":
        made = trimesh.creation.icosphere(3, size[0])
    elif kind == "cylinder":
        made = trimesh.creation.cylinder(*size, sections=64)
    elif kind == "cone":
        made = trimesh.creation.cone(*size, sections=64)
    else:
        made = trimesh.creation.box(size)
    if pose is not None:
        made.apply_transform(np.asarray(pose))
    return made


def cloud_of(
    mesh: trimesh.Trimesh,
    eye: ArrayLike,
    *,
    points: int = 4000,
    noise: float = 0.001,
    outliers: float = 0.0,
    seed: int = 0,
) -> NDArray[np.float64]:
    """About so many points of the side that faces a camera, in the frame of the mesh."""
    random = np.random.default_rng(seed)
    middle, radius = mesh.bounds.mean(axis=0), np.linalg.norm(mesh.extents) / 2
    distance = float(np.linalg.norm(middle - eye))
    pixels = int(1.6 * points**0.5)
    for _ in range(2):
        focal = pixels / 2 * distance / radius
        camera = DepthCamera(
            (pixels, pixels), (focal, focal, pixels / 2, pixels / 2), look_at(eye, middle)
        )
        depths, _ = camera.image(np.asarray(mesh.triangles))
        row, column = np.nonzero(np.isfinite(depths))
        pixels = int(pixels * (points / max(len(row), 1)) ** 0.5) + 1
    width = camera.size[0]
    ray = np.stack([(column - width / 2) / focal, (row - width / 2) / focal, 1 + 0.0 * row], 1)
    depth = depths[row, column] + random.normal(0, noise, len(row))
    seen = (ray * depth[:, None]) @ camera.pose[:3, :3].T + camera.pose[:3, 3]
    low, high = seen.min(axis=0) - 0.02, seen.max(axis=0) + 0.02
    return np.vstack([seen, random.uniform(low, high, (int(outliers * len(seen)), 3))])
