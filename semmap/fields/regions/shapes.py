"""Regions of space in metres, and the voxels that belong to them.

A voxel is ``floor(p / voxel_size)``. It belongs to a solid if its centre lies in it, the surface
included, to 1e-9 of a voxel. All that they meet belong to a `Surface`, and to a solid so thin that
it could lie between centres: narrower than a voxel in one direction, than sqrt(2) voxels in two, or
than sqrt(3) in three. Of a thin `Cylinder` or `Cone` the prism or pyramid around it is taken, up to
0.01 voxels wider where its radius is below 1,000 voxels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.limits import REGION_BLOCKS, REGION_VOXELS
from semmap_vdb import Shape, limit_regions

__all__ = [
    "Box",
    "Cone",
    "Cylinder",
    "DepthImage",
    "Hull",
    "Region",
    "Solid",
    "Sphere",
    "Surface",
    "voxels_of",
]

MOST_VOXELS, MOST_BLOCKS = 2**36, 2**27
"""To which the limits of a region can be raised: indices and memory do not reach further."""

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class Box:
    """A cuboid.

    Parameters
    ----------
    center : (3,) metres
    size : (3,) metres
        Along its own axes; 0 makes a rectangle, a segment or a point of it.
    rotation : (4,)
        Unit quaternion (x, y, z, w), of its axes in the map's frame.
    """

    center: ArrayLike
    size: ArrayLike
    rotation: ArrayLike = (0.0, 0.0, 0.0, 1.0)
    shape: Shape = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse what is no box."""
        center = np.array(_vector(self.center, "Box.center"))
        half = np.array(_vector(self.size, "Box.size")) / 2
        if (half < 0).any():
            raise ValueError(f"Box.size is {self.size!r}: give lengths of at least 0 m")
        axes = _rotation(self.rotation, "Box.rotation")
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        corners = center + (signs * half) @ axes.T
        normals = np.concatenate([axes.T, -axes.T])
        _set(self, Shape.polytope(corners, normals, np.ascontiguousarray(axes.T)))


@dataclass(frozen=True, eq=False)
class Sphere:
    """A ball.

    Parameters
    ----------
    center : (3,) metres
    radius : float
        Metres, above 0.
    """

    center: ArrayLike
    radius: float
    shape: Shape = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse what is no ball."""
        center = _vector(self.center, "Sphere.center")
        _set(self, Shape.ball(center, _above_0(self.radius, "Sphere.radius")))


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A cylinder with flat ends.

    Parameters
    ----------
    center : (3,) metres
        The middle of its axis.
    radius : float
        Metres, above 0.
    height : float
        Metres along the axis; 0 makes a disc of it.
    axis : (3,)
        The direction of its axis, of any length.
    """

    center: ArrayLike
    radius: float
    height: float
    axis: ArrayLike = (0.0, 0.0, 1.0)
    shape: Shape = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse what is no cylinder."""
        center = _vector(self.center, "Cylinder.center")
        axis = _direction(self.axis, "Cylinder.axis")
        radius = _above_0(self.radius, "Cylinder.radius")
        height = float(self.height)
        if not (math.isfinite(height) and height >= 0):
            raise ValueError(f"Cylinder.height is {self.height!r}: give metres of at least 0")
        _set(self, Shape.cylinder(center, axis, radius, height))


@dataclass(frozen=True, eq=False)
class Cone:
    """A cone from its apex to a flat base.

    Parameters
    ----------
    apex : (3,) metres
    axis : (3,)
        From the apex into the cone, of any length.
    angle : float
        The full opening angle in radians, above 0 and below pi.
    height : float
        Metres from the apex to the base, above 0.
    """

    apex: ArrayLike
    axis: ArrayLike
    angle: float
    height: float
    shape: Shape = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse what is no cone."""
        apex = _vector(self.apex, "Cone.apex")
        axis = _direction(self.axis, "Cone.axis")
        angle = float(self.angle)
        if not 0 < angle < math.pi:
            raise ValueError(
                f"Cone.angle is {self.angle!r}: give the full opening angle, in radians between 0 "
                "and pi"
            )
        _set(self, Shape.cone(apex, axis, angle / 2, _above_0(self.height, "Cone.height")))


@dataclass(frozen=True, eq=False)
class Hull:
    """The convex hull of points: a polytope, or a polygon, a segment or a point.

    Parameters
    ----------
    points : (N, 3) metres
        At least one.
    """

    points: ArrayLike
    shape: Shape = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse what has no hull."""
        points = _points(self.points, "Hull.points")
        if len(points) == 0:
            raise ValueError("Hull.points is empty: give at least one point")
        _set(self, Shape.polytope(*_hull(points)))


@dataclass(frozen=True, eq=False)
class Solid:
    """What a closed triangle mesh encloses.

    The winding number says what is inside, whichever way the faces turn: parts may overlap, and a
    part that turns the other way within another is a cavity. Thinness is looked at part by part.

    Parameters
    ----------
    vertices : (N, 3) metres
        Those of the same place are one vertex.
    faces : (M, 3) integers
        Vertices of each triangle, from 0.

    Raises
    ------
    ValueError
        Where the mesh is not closed: give a `Surface`.
    """

    vertices: ArrayLike
    faces: ArrayLike
    shape: Shape = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse what has no inside."""
        vertices = _points(self.vertices, "Solid.vertices")
        _set(self, Shape.solid(vertices, _faces(self.faces, len(vertices), "Solid.faces")))


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles without an inside: all the voxels that they meet.

    Parameters
    ----------
    vertices : (N, 3) metres
    faces : (M, 3) integers
        Vertices of each triangle, from 0.
    """

    vertices: ArrayLike
    faces: ArrayLike
    shape: Shape = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse faces of vertices that are not there."""
        vertices = _points(self.vertices, "Surface.vertices")
        _set(self, Shape.surface(vertices, _faces(self.faces, len(vertices), "Surface.faces")))


@dataclass(frozen=True, eq=False)
class DepthImage:
    """What a depth camera sees: the points of its pixels, as of a surface seen from one side.

    There are gaps where neighbouring pixels lie further apart than a voxel.

    Parameters
    ----------
    depth : (H, W) metres
        Along the camera's z axis; NaN, infinity and what is not above 0 are left out.
    intrinsics : (4,)
        fx, fy, cx, cy in pixels, the centre of the first pixel at (0, 0).
    pose : (4, 4)
        Of the camera's optical frame (x right, y down, z ahead) in the map's.
    mask : (H, W) bool, optional
        The pixels that are meant; all if not given.
    farthest : float
        Metres of depth beyond which pixels are left out.
    """

    depth: ArrayLike
    intrinsics: ArrayLike
    pose: ArrayLike
    mask: ArrayLike | None = None
    farthest: float = math.inf
    shape: Shape = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse what is no image of a camera."""
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
        pose = _rigid(self.pose, "DepthImage.pose")
        _set(self, Shape.depth_image(depth, mask, (fx, fy, cx, cy), pose, float(self.farthest)))


Region = Box | Sphere | Cone | Cylinder | Hull | Solid | Surface | DepthImage | NDArray[Any]
"""A region, or the points (N, 3) in metres of one."""


def shape_of(region: Region) -> Shape:
    """A region as the native code takes it, which is told the limits of `semmap.limits`."""
    limit_regions(
        min(int(REGION_VOXELS.value), MOST_VOXELS), min(int(REGION_BLOCKS.value), MOST_BLOCKS)
    )
    if isinstance(region, Box | Sphere | Cone | Cylinder | Hull | Solid | Surface | DepthImage):
        return region.shape
    return Shape.points(_points(region, "a region of points"))


def voxels_of(region: Region, voxel_size: float) -> NDArray[np.int32]:
    """The voxels of a region.

    Returns
    -------
    (N, 3) int32
        Indices, each once, block by block of 8 x 8 x 8.
    """
    return shape_of(region).voxels(_above_0(voxel_size, "voxel_size"))


def _set(region: object, shape: Shape) -> None:
    object.__setattr__(region, "shape", shape)


def _above_0(value: float, name: str) -> float:
    number = float(value)
    if not (math.isfinite(number) and number > 0):
        raise ValueError(f"{name} is {value!r}: give metres above 0")
    return number


def _vector(value: ArrayLike, name: str) -> Vector:
    array = np.asarray(value, dtype=float)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ValueError(f"{name} is {value!r}: give three finite numbers")
    return float(array[0]), float(array[1]), float(array[2])


def _direction(value: ArrayLike, name: str) -> Vector:
    x, y, z = _vector(value, name)
    length = math.hypot(x, y, z)
    if not 0 < length < math.inf:
        raise ValueError(f"{name} is {value!r}: a direction has a length above 0")
    return x / length, y / length, z / length


def _rotation(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Columns: the axes."""
    q = np.asarray(value, dtype=float)
    if q.shape != (4,) or not abs(float(np.linalg.norm(q)) - 1) < 1e-6:
        raise ValueError(f"{name} is {value!r}: give a unit quaternion (x, y, z, w)")
    x, y, z, w = (q / np.linalg.norm(q)).tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _rigid(value: ArrayLike, name: str) -> list[list[float]]:
    """The upper three rows."""
    m = np.asarray(value, dtype=float)
    if m.shape != (4, 4) or not np.isfinite(m).all():
        raise ValueError(f"{name}: give a (4, 4) rigid transform of finite numbers")
    turn = m[:3, :3]
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) or not np.allclose(m[3], (0, 0, 0, 1)):
        raise ValueError(f"{name}: give a (4, 4) rigid transform: a rotation, no scale, no shear")
    rows: list[list[float]] = m[:3].tolist()
    return rows


def _points(value: ArrayLike, name: str) -> NDArray[np.float64]:
    points = np.ascontiguousarray(value, dtype=np.float64)
    if points.shape == (0,):
        points = points.reshape(0, 3)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{name} has shape {points.shape}: give an (N, 3) array")
    if not np.isfinite(points).all():
        raise ValueError(f"{name} holds NaN or infinity: leave those points out")
    return points


def _faces(value: ArrayLike, vertices: int, name: str) -> NDArray[np.int32]:
    faces = np.asarray(value)
    if faces.ndim != 2 or faces.shape[1] != 3 or not np.issubdtype(faces.dtype, np.integer):
        raise ValueError(f"{name}: give an (M, 3) array of integers")
    if faces.size and (faces.min() < 0 or faces.max() >= vertices):
        raise ValueError(f"{name}: there are vertices 0 to {vertices - 1}, name no others")
    return np.ascontiguousarray(faces, dtype=np.int32)


_Polytope = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def _hull(points: NDArray[np.float64]) -> _Polytope:
    """Corners, normals of facets and directions of edges; a flat hull has two normals or none."""
    from scipy.spatial import ConvexHull

    middle = points.mean(axis=0)
    spread = np.linalg.svd(points - middle, full_matrices=True)
    lengths = np.zeros(3)
    lengths[: len(spread.S)] = spread.S
    none = np.zeros((0, 3))
    far = max(float(np.abs(points).max()), 1e-300)
    dimension = int((lengths > 1e-12 * far * math.sqrt(len(points))).sum())
    axes = spread.Vh
    if dimension == 0:
        return points[:1].copy(), none, none
    if dimension == 1:
        at = (points - middle) @ axes[0]
        ends = points[[int(at.argmin()), int(at.argmax())]]
        return ends, none, axes[:1].copy()
    if dimension == 2:
        ring = points[ConvexHull((points - middle) @ axes[:2].T).vertices]
        normal = np.cross(axes[0], axes[1])
        return ring, np.stack([normal, -normal]), np.roll(ring, -1, axis=0) - ring
    hull = ConvexHull(points - middle)
    normals = np.unique(np.round(hull.equations[:, :3], 12), axis=0)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    corners = points[hull.simplices]
    edges = (corners - np.roll(corners, 1, axis=1)).reshape(-1, 3)
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    edges[edges[:, 0] < 0] *= -1
    edges = np.unique(np.round(edges, 12), axis=0)
    return points[hull.vertices], np.ascontiguousarray(normals), edges
