"""Regions of space in metres, and the voxels that belong to them.

The voxel of a point p is ``floor(p / voxel_size)``. A voxel belongs to a solid if its centre lies
in the solid or on its surface, to 1e-9 of a voxel.

A thin solid could lie between the centres: one that is narrower than a voxel in one direction, than
sqrt(2) voxels in two, or than sqrt(3) in three. All voxels that such a solid meets belong to it, as
do all that meet a `SurfaceRegion`. A thin `Cylinder` or `Cone` is replaced by the prism or pyramid
around it, which is up to 0.01 voxels wider where the radius is below 1,000 voxels.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.fields.checks import (
    as_direction,
    as_faces,
    as_length,
    as_points,
    as_rigid_rows,
    as_rotation,
    as_vector,
    positive,
)
from semmap.limits import REGION_BLOCKS, REGION_VOXELS
from semmap_vdb import Shape, limit_regions

MOST_VOXELS, MOST_BLOCKS = 2**36, 2**27
"""The highest limits of a region: beyond them, indices and memory do not suffice."""

FARTHEST = 1e50
"""Metres from which on a hull is refused: products of three coordinates can still be computed."""


@dataclass(frozen=True, eq=False)
class ShapedRegion(ABC):
    """A region whose arguments are checked when it is made."""

    shape: Shape = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", self._native())

    @abstractmethod
    def _native(self) -> Shape: ...


@dataclass(frozen=True, eq=False)
class Box(ShapedRegion):
    """A cuboid; with a size of 0 in a direction, a rectangle, a segment or a point.

    Parameters
    ----------
    center : (3,) metres
    size : (3,) metres; along the axes of the box
    rotation : (4,) unit quaternion (x, y, z, w): the axes of the box in the frame of the map
    """

    center: ArrayLike
    size: ArrayLike
    rotation: ArrayLike = (0.0, 0.0, 0.0, 1.0)

    def _native(self) -> Shape:
        center = np.array(as_vector(self.center, "Box.center"))
        half = np.array(as_vector(self.size, "Box.size")) / 2
        if (half < 0).any():
            raise ValueError(f"Box.size is {self.size!r}: give lengths of at least 0 m")
        axes = as_rotation(self.rotation, "Box.rotation")
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        corners = center + (signs * half) @ axes.T
        normals = np.concatenate([axes.T, -axes.T])
        return Shape.polytope(corners, normals, np.ascontiguousarray(axes.T))


@dataclass(frozen=True, eq=False)
class Sphere(ShapedRegion):
    """A ball: `center` (3,) and `radius` above 0, metres."""

    center: ArrayLike
    radius: float

    def _native(self) -> Shape:
        center = as_vector(self.center, "Sphere.center")
        return Shape.ball(center, positive(self.radius, "Sphere.radius"))


@dataclass(frozen=True, eq=False)
class Cylinder(ShapedRegion):
    """A cylinder with flat ends; with a height of 0, a disc.

    Parameters
    ----------
    center : (3,) metres; the middle of its axis
    radius, height : metres; the radius is above 0
    axis : (3,) the direction of its axis, of any length
    """

    center: ArrayLike
    radius: float
    height: float
    axis: ArrayLike = (0.0, 0.0, 1.0)

    def _native(self) -> Shape:
        center = as_vector(self.center, "Cylinder.center")
        axis = as_direction(self.axis, "Cylinder.axis")
        radius = positive(self.radius, "Cylinder.radius")
        height = as_length(self.height, "Cylinder.height")
        return Shape.cylinder(center, axis, radius, height)


@dataclass(frozen=True, eq=False)
class Cone(ShapedRegion):
    """A cone from its apex to a flat base.

    Parameters
    ----------
    apex : (3,) metres
    axis : (3,) from the apex into the cone, of any length
    angle : the full opening angle in radians, above 0 and below pi
    height : metres from the apex to the base, above 0
    """

    apex: ArrayLike
    axis: ArrayLike
    angle: float
    height: float

    def _native(self) -> Shape:
        apex = as_vector(self.apex, "Cone.apex")
        axis = as_direction(self.axis, "Cone.axis")
        angle = float(self.angle)
        if not 0 < angle < math.pi:
            raise ValueError(
                f"Cone.angle is {self.angle!r}: give the full opening angle, in radians between 0 "
                "and pi"
            )
        return Shape.cone(apex, axis, angle / 2, positive(self.height, "Cone.height"))


@dataclass(frozen=True, eq=False)
class Hull(ShapedRegion):
    """The convex hull of points (N, 3), metres: a polytope, or a polygon, a segment or a point."""

    points: ArrayLike

    def _native(self) -> Shape:
        points = as_points(self.points, "Hull.points")
        if len(points) == 0:
            raise ValueError("Hull.points is empty: give at least one point")
        return Shape.polytope(*convex_hull(points))


@dataclass(frozen=True, eq=False)
class Solid(ShapedRegion):
    """The inside of a closed triangle mesh: vertices (N, 3), metres, and faces (M, 3).

    A point is inside where the winding number is not 0, whichever way the faces turn: parts may
    overlap, and a part within another that turns the other way is a cavity. Each part is checked
    for thinness by itself. Vertices at the same place count as one. A mesh that is not closed
    raises a ValueError: use a `SurfaceRegion`.
    """

    vertices: ArrayLike
    faces: ArrayLike

    def _native(self) -> Shape:
        vertices = as_points(self.vertices, "Solid.vertices")
        return Shape.solid(vertices, as_faces(self.faces, len(vertices), "Solid.faces"))


@dataclass(frozen=True, eq=False)
class SurfaceRegion(ShapedRegion):
    """Triangles without an inside: all voxels that they meet.

    They are vertices (N, 3), metres, and faces (M, 3).
    """

    vertices: ArrayLike
    faces: ArrayLike

    def _native(self) -> Shape:
        vertices = as_points(self.vertices, "SurfaceRegion.vertices")
        faces = as_faces(self.faces, len(vertices), "SurfaceRegion.faces")
        return Shape.surface(vertices, faces)


@dataclass(frozen=True, eq=False)
class DepthImage(ShapedRegion):
    """The points that a depth camera sees, one for each pixel.

    There are gaps where neighbouring pixels are further apart than a voxel.

    Parameters
    ----------
    depth : (H, W) metres along the z axis of the camera; NaN, infinity and values up to 0 are left
        out
    intrinsics : (4,) fx, fy, cx, cy in pixels; the centre of the first pixel is (0, 0)
    pose : (4, 4) of the optical frame (x right, y down, z ahead) in the frame of the map
    mask : (H, W) the pixels to use; all if not given
    farthest : metres of depth beyond which pixels are left out
    """

    depth: ArrayLike
    intrinsics: ArrayLike
    pose: ArrayLike
    mask: ArrayLike | None = None
    farthest: float = math.inf

    def _native(self) -> Shape:
        depth = np.ascontiguousarray(self.depth, dtype=np.float32)
        if depth.ndim != 2:
            raise ValueError(f"DepthImage.depth has shape {depth.shape}: give an (H, W) array")
        mask = None
        if self.mask is not None:
            mask = np.ascontiguousarray(self.mask, dtype=np.bool_)
            if mask.shape != depth.shape:
                raise ValueError(
                    f"DepthImage.mask has shape {mask.shape}: give that of depth, {depth.shape}"
                )
        camera = np.asarray(self.intrinsics, dtype=float)
        if camera.shape != (4,) or not np.isfinite(camera).all() or not (camera[:2] > 0).all():
            raise ValueError(
                f"DepthImage.intrinsics is {self.intrinsics!r}: give fx, fy, cx, cy in pixels, "
                "fx and fy above 0"
            )
        fx, fy, cx, cy = camera.tolist()
        pose = as_rigid_rows(self.pose, "DepthImage.pose")
        return Shape.depth_image(depth, mask, (fx, fy, cx, cy), pose, float(self.farthest))


Region = ShapedRegion | NDArray[Any]
"""A region, or the points (N, 3) in metres of one."""


def shape_of(region: Region) -> Shape:
    """Return the native shape of a region, and apply the limits of `semmap.limits` to it."""
    limit_regions(
        min(int(REGION_VOXELS.value), MOST_VOXELS), min(int(REGION_BLOCKS.value), MOST_BLOCKS)
    )
    if isinstance(region, ShapedRegion):
        return region.shape
    return Shape.points(as_points(region, "a region of points"))


def voxels_of(region: Region, voxel_size: float) -> NDArray[np.int32]:
    """Return the voxels of a region, (N, 3), each once, for voxels of an edge in metres."""
    return shape_of(region).voxels(positive(voxel_size, "voxel_size"))


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
