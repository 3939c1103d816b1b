"""Solids that objects are modelled as: cuboid, cylinder, sphere, cone, in their own frames.

The origin is the centre, of a cone that of its base; z is the axis of cylinder and cone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from semmap.arrays import Floats
from semmap.geometry.mesh import Mesh
from semmap.manipulation.error import ManipulationError

SIZES = {
    "cuboid": ("x", "y", "z"),
    "cylinder": ("radius", "height"),
    "sphere": ("radius",),
    "cone": ("radius", "height"),
}
"""The sizes of each kind, metres."""


FITS = 0.95
"""The share of a mesh on its primitive from which that stands for it: a teapot is no sphere."""


class PrimitiveShape(Protocol):
    """A fitted primitive as in `SIZES`; `pose` (4, 4) is its frame in that of the model."""

    @property
    def kind(self) -> str:
        """One of `SIZES`."""
        ...

    @property
    def size(self) -> tuple[float, ...]:
        """Metres, as `SIZES` names them."""
        ...

    @property
    def pose(self) -> Floats:
        """(4, 4): the frame of the solid in the frame of the model."""
        ...

    @property
    def inliers(self) -> float:
        """The share of the object's surface that is on that of the solid, 0 to 1."""
        ...


@dataclass(frozen=True, eq=False)
class ConvexSolid:
    """A convex solid: the points p with N p <= b and p A p + k p <= c.

    `planes` (P, 3) are the outward normals N, `offsets` (P,) b; `quadric` (3,) is the diagonal of
    A, `linear` (3,) k and `level` c, all 0 for none; `centre` (3,) is that of mass.
    """

    kind: str
    size: tuple[float, ...]
    planes: Floats
    offsets: Floats
    quadric: Floats
    linear: Floats
    level: float
    centre: Floats
    volume: float

    def contains(self, points: Floats, slack: float = 1e-9) -> NDArray[np.bool_]:
        """Return whether each of (..., 3) points is in the solid."""
        inside = np.all(points @ self.planes.T <= self.offsets + slack, axis=-1)
        if self.quadric.any():
            inside &= (points**2) @ self.quadric + points @ self.linear <= self.level + slack
        return np.asarray(inside)

    def exits(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Where rays from inside, unit (N, 3), leave: metres (N,), and outward normals (N, 3)."""
        towards = directions @ self.planes.T
        with np.errstate(divide="ignore", invalid="ignore"):
            flat = np.where(
                towards > 1e-12, (self.offsets - points @ self.planes.T) / towards, np.inf
            )
        face = np.argmin(flat, axis=1) if len(self.planes) else np.zeros(len(points), np.intp)
        distance = np.min(flat, axis=1, initial=np.inf)
        normals = self.planes[face] if len(self.planes) else np.zeros(points.shape)
        if self.quadric.any():
            a = (directions**2) @ self.quadric
            b = 2 * (points * directions) @ self.quadric + directions @ self.linear
            c = (points**2) @ self.quadric + points @ self.linear - self.level
            root = np.sqrt(np.maximum(b**2 - 4 * a * c, 0))
            with np.errstate(divide="ignore", invalid="ignore"):
                roots = np.stack([-2 * c / (b + root), -2 * c / (b - root)])
            curved = np.where(roots > 1e-12, roots, np.inf).min(axis=0)
            round_first = curved < distance
            distance = np.where(round_first, curved, distance)
            at = points + np.where(np.isfinite(distance), distance, 0)[:, None] * directions
            gradient = 2 * at * self.quadric + self.linear
            length = np.linalg.norm(gradient, axis=1, keepdims=True)
            steep = length > 1e-4 * self.size[0]  # the tip of a cone has no normal
            curved_normals = np.where(steep, gradient / np.maximum(length, 1e-12), 0)
            normals = np.where(round_first[:, None], curved_normals, normals)
        return distance, normals

    def mesh(self, sections: int = 48) -> Mesh:
        """Return the surface; round faces are polygons of `sections` sides within the solid."""
        import trimesh

        if self.kind == "cuboid":
            made = trimesh.creation.box(extents=self.size)
        elif self.kind == "cylinder":
            made = trimesh.creation.cylinder(self.size[0], self.size[1], sections=sections)
        elif self.kind == "cone":
            made = trimesh.creation.cone(self.size[0], self.size[1], sections=sections)
        else:
            made = trimesh.creation.icosphere(subdivisions=3, radius=self.size[0])
        return Mesh(np.asarray(made.vertices, np.float64), np.asarray(made.faces, np.int32))


def solid_of(kind: str, size: Sequence[float]) -> ConvexSolid:
    """The solid of a kind and its sizes; ManipulationError where they give no volume.

    >>> solid_of("cylinder", (0.03, 0.1)).exits(np.zeros((1, 3)), np.array([[1.0, 0, 0]]))
    (array([0.03]), array([[1., 0., 0.]]))
    """
    names = SIZES.get(kind)
    if names is None:
        raise ManipulationError(f"shape {kind}: give one of {', '.join(SIZES)}")
    sizes = tuple(float(s) for s in size)
    if len(sizes) != len(names):
        raise ManipulationError(f"{kind}: has {len(sizes)} sizes; give {', '.join(names)}")
    if not all(np.isfinite(s) and s > 0 for s in sizes):
        raise ManipulationError(
            f"{kind}: its sizes {', '.join(f'{s:g}' for s in sizes)} give no volume; "
            f"give {', '.join(names)} above 0 m"
        )
    radius, height = sizes[0], sizes[-1]
    none, disc, slope = np.zeros(3), np.array([1.0, 1, 0]), radius / height
    ends, round_ = np.array([[0.0, 0, 1], [0, 0, -1]]), np.pi * radius**2
    if kind == "cuboid":
        sides, half = np.concatenate([np.eye(3), -np.eye(3)]), np.tile(np.array(sizes) / 2, 2)
        return ConvexSolid(kind, sizes, sides, half, none, none, 0, none, float(np.prod(sizes)))
    if kind == "sphere":
        faces, quadric, linear, centre = ends[:0], np.ones(3), none, none
        offsets, volume = np.zeros(0), 4 / 3 * radius * round_
    elif kind == "cylinder":
        faces, quadric, linear, centre = ends, disc, none, none
        offsets, volume = np.full(2, height / 2), height * round_
    else:  # (x, y) within r (1 - z / h): x² + y² - (r/h)² z² + 2 (r²/h) z <= r²
        faces, quadric, linear = ends, disc - [0, 0, slope**2], np.array([0, 0, 2 * slope * radius])
        centre, volume = np.array([0, 0, height / 4]), height * round_ / 3
        offsets = np.array([height * (1 + 1e-6), 0.0])  # above the tip
    return ConvexSolid(
        kind, sizes, faces, offsets, quadric, linear, radius**2, centre, float(volume)
    )


def solid_hull(points: Floats) -> tuple[float, Floats]:
    """The volume and the centre of mass (3,) of the convex hull of points (N, 3)."""
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        hull = None
    size = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if hull is None or hull.volume < 1e-6 * size**3 or hull.volume == 0:
        raise ManipulationError(
            "object: its mesh has no volume; give a mesh of a solid, or fit a shape to its points"
        )
    middle = points[hull.vertices].mean(axis=0)
    corners = points[hull.simplices] - middle
    volumes = np.abs(np.linalg.det(corners))
    centre = middle + (corners.sum(axis=1) / 4 * volumes[:, None]).sum(axis=0) / volumes.sum()
    return float(hull.volume), centre
