"""Models of known objects: what cameras around a mesh see (O'Neill's thesis, section 5.0.4).

A descriptor is a histogram about the line of sight, so that a camera's roll does not change it; the
roll follows from a signature over the angle about the line of sight.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, cKDTree

from semmap.draw.depth_camera import DepthCamera, look_at
from semmap.geometry.mesh import Mesh
from semmap.perception.hypotheses import frame_with_axis
from semmap.perception.point_cloud import Floats, PerceptionError, surfels, voxel_downsample
from semmap.perception.registration import IcpTarget

VOXEL = 0.004
"""Metres between the points of views and clusters."""

ACROSS, AHEAD, TILT, TURN = 10, 10, 8, 48
"""Bins of descriptors: distance from the line of sight, depth, tilt of normals; and of angles."""

WIDEST = 0.3
"""Metres that the bins reach from the middle."""


class PointView(NamedTuple):
    """Points as seen along the line of sight to their mean."""

    centre: Floats  # (3,) mean of the points
    frame: Floats  # (3, 3) the third column is the line of sight
    descriptor: Floats  # (bins,) the same for each roll of the camera
    signature: Floats  # (channels, TURN) over the angle about the line of sight


class ModelView(NamedTuple):
    """What a camera sees of a model."""

    direction: Floats  # (3,) from the model's middle to the camera
    points: Floats  # (n, 3) in the frame of the model, metres
    look: PointView  # their descriptor


@dataclass(frozen=True, eq=False)
class KnownObject:
    """A known object."""

    name: str  # of the object or its class
    views: tuple[ModelView, ...]  # from directions all around

    @cached_property
    def points(self) -> Floats:
        """(n, 3): what is seen from anywhere, in the frame of the model, metres."""
        return voxel_downsample(np.concatenate([v.points for v in self.views]), VOXEL)

    @cached_property
    def width(self) -> float:
        """Diagonal of the box around the points, metres."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @cached_property
    def target(self) -> IcpTarget:
        """`points`, prepared for ICP."""
        return IcpTarget(self.points)

    @cached_property
    def tree(self) -> cKDTree:
        """Of `points`."""
        return cKDTree(self.points)

    @cached_property
    def descriptors(self) -> Floats:
        """(views, bins)."""
        return np.array([view.look.descriptor for view in self.views])

    @cached_property
    def directions(self) -> Floats:
        """(views, 3)."""
        return np.array([view.direction for view in self.views])


def train_model(name: str, mesh: Mesh, *, views: int = 42) -> KnownObject:
    """Return a model of a mesh, metres, seen from directions that cover the sphere evenly.

    Raises PerceptionError: a mesh of no volume, or wider than 0.6 m: this recogniser is for objects
    on tables.
    """
    used = mesh.used
    width = np.ptp(used, axis=0) if len(used) else np.zeros(3)
    try:
        volume = ConvexHull(used).volume
    except (ValueError, RuntimeError):
        volume = 0.0
    if not np.isfinite(width).all() or not volume > 1e-9:
        raise PerceptionError(f"{name}: the mesh has no volume: give the mesh of a solid")
    if np.linalg.norm(width) > 2 * WIDEST:
        raise PerceptionError(
            f"{name} is {np.linalg.norm(width):.2f} m wide: a model is an object of at most "
            f"{2 * WIDEST} m; give furniture as a placeholder"
        )
    middle = (used.min(axis=0) + used.max(axis=0)) / 2
    radius = float(np.linalg.norm(width)) / 2
    return KnownObject(
        name, tuple(_view(mesh.triangles, middle, radius, d) for d in sphere_directions(views))
    )


def sphere_directions(count: int) -> Floats:
    """Return unit vectors (count, 3) that cover the sphere evenly, on a Fibonacci spiral."""
    z = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (1 + 5**0.5) * np.arange(count)
    rho = np.sqrt(1 - z**2)
    return np.stack([rho * np.cos(turn), rho * np.sin(turn), z], axis=1)


def depth_points(camera: DepthCamera, depths: ArrayLike) -> Floats:
    """Return points (height, width, 3) in the camera's frame, NaN where a depth, in metres, is."""
    fx, fy, cx, cy = camera.intrinsics
    ahead = np.asarray(depths, float)
    row, column = np.indices(ahead.shape)
    rays = np.stack([(column - cx) / fx, (row - cy) / fy, np.ones(ahead.shape)], axis=-1)
    return np.asarray(rays * ahead[..., None])


def describe(points: Floats, eye: Floats) -> PointView:
    """Return the descriptor of points (n, 3) that a camera at `eye` (3,) sees."""
    centre = points.mean(axis=0)
    sight = centre - eye
    frame = frame_with_axis(sight / np.linalg.norm(sight))
    local = (points - centre) @ frame
    normals = surfels(points, 12).normals @ frame
    rho = np.hypot(local[:, 0], local[:, 1])
    shape, _, _ = np.histogram2d(
        rho, local[:, 2], (ACROSS, AHEAD), ((0, WIDEST / 2), (-WIDEST / 2, WIDEST / 2))
    )
    tilt, _ = np.histogram(np.abs(normals[:, 2]), TILT, (0, 1))
    descriptor = np.sqrt(np.concatenate([shape.ravel(), tilt]) / len(points))
    angle = np.arctan2(local[:, 1], local[:, 0]) % (2 * np.pi)
    sector = (angle / (2 * np.pi) * TURN).astype(int) % TURN
    channels = (rho, rho * local[:, 2] * 10, rho * np.abs(normals[:, 2]))
    signature = np.array([np.bincount(sector, w, TURN) for w in channels]) / len(points)
    return PointView(centre, frame, descriptor, signature)


def _view(triangles: Floats, middle: Floats, radius: float, direction: Floats) -> ModelView:
    """Render a mesh from four radii away; a pixel is about half a voxel wide."""
    eye = middle + 4 * radius * direction
    pixels = int(np.clip(2.3 * radius / (VOXEL / 2), 24, 240))
    focal = pixels / 2 / 0.29
    centre = (pixels - 1) / 2
    camera = DepthCamera(
        (pixels, pixels), (focal, focal, centre, centre), look_at(eye, middle), radius
    )
    depths, _ = camera.image(triangles)
    seen = depth_points(camera, depths).reshape(-1, 3)
    seen = seen[np.isfinite(seen[:, 0])] @ camera.pose[:3, :3].T + eye
    points = voxel_downsample(seen, VOXEL)
    return ModelView(direction, points, describe(points, eye))
