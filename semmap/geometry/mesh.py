"""Triangle meshes as two arrays."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.extent import extent
from semmap.geometry.pose import Pose

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh: vertices (V, 3), metres, in its own frame, and faces (F, 3)."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]

    @classmethod
    def of_triangles(cls, triangles: NDArray[np.float64]) -> Mesh:
        """Triangles (F, 3, 3) with vertices of their own; `to_mesh` joins equal ones."""
        return cls(
            triangles.reshape(-1, 3), np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3)
        )

    @property
    def triangles(self) -> NDArray[np.float64]:
        """(F, 3, 3): the corners of each face."""
        return np.take(self.vertices, self.faces, axis=0)

    @property
    def used(self) -> NDArray[np.float64]:
        """(U, 3): the vertices that faces use, each once."""
        of_a_face = np.zeros(len(self.vertices), dtype=bool)
        of_a_face[self.faces.ravel()] = True
        return self.vertices[of_a_face]

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3): lowest and highest corner of the vertices that faces use."""
        return np.stack(extent(self.used))

    @property
    def is_closed(self) -> bool:
        """Whether the surface has an inside: each edge belongs to an even number of faces.

        Vertices count as one where their coordinates are equal. The numbers of all edges are
        combined by exclusive or: those that occur twice cancel out, at a risk of error of 2**-64.
        """
        at = (self.vertices + 0.0).view(np.uint64) * _PRIMES  # -0.0 is 0.0
        numbers = _mixed(_mixed(_mixed(at[:, 0]) ^ at[:, 1]) ^ at[:, 2])
        corners = numbers[self.faces]
        ends = np.roll(corners, -1, axis=1)
        edges = np.where(corners == ends, np.uint64(0), _mixed(corners + ends))
        return len(self.faces) > 0 and not np.bitwise_xor.reduce(edges, axis=None)

    def digest(self) -> str:
        """Return a hash of the content: equal meshes are stored once."""
        h = hashlib.sha256()
        h.update(np.ascontiguousarray(self.vertices, dtype="<f8").tobytes())
        h.update(np.ascontiguousarray(self.faces, dtype="<i4").tobytes())
        return h.hexdigest()

    def moved(self, pose: Pose, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Mesh:
        """Return this mesh scaled, then placed by `pose`; mirrored faces are turned back."""
        faces = self.faces if np.prod(scale) > 0 else self.faces[:, ::-1]
        return Mesh(pose.apply(self.vertices * np.asarray(scale)), np.ascontiguousarray(faces))


_PRIMES = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)


def _mixed(numbers: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Each number with its bits spread over all 64, as splitmix64 does."""
    z = (numbers ^ (numbers >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def join(meshes: list[Mesh]) -> Mesh:
    """Return one mesh of several that share a frame."""
    offsets = np.cumsum([0, *(len(m.vertices) for m in meshes[:-1])])
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces + o for m, o in zip(meshes, offsets, strict=True)], dtype=np.int32),
    )


def box_mesh(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    """Return the closed surface of an axis-aligned box: 12 triangles, normals outward."""
    corners = np.array([[(low, high)[(i >> k) & 1][k] for k in range(3)] for i in range(8)], float)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return Mesh(corners, np.array(faces, dtype=np.int32))


def voxel_mesh(voxels: NDArray[np.int64]) -> Mesh:
    """Two triangles for each side of a voxel (N, 3) that no other covers; vertices in voxels."""
    low, shape = voxels.min(axis=0) - 1, np.ptp(voxels, axis=0) + 3

    def number(at: NDArray[np.int64]) -> NDArray[np.int64]:
        x, y, z = (at - low).T
        return np.asarray((x * shape[1] + y) * shape[2] + z)

    occupied = np.sort(number(voxels))
    corners: list[NDArray[np.int64]] = []
    for axis in range(3):
        one = np.eye(3, dtype=np.int64)[axis]
        u, v = np.roll(one, 1), np.roll(one, 2)
        for outward in (1, -1):
            beside = number(voxels + outward * one)
            at = np.searchsorted(occupied, beside)
            taken = occupied[np.minimum(at, len(occupied) - 1)] == beside
            base = voxels[~taken] + (one if outward > 0 else 0)
            ring = [base, base + u, base + u + v, base + v]
            corners.append(np.stack(ring if outward > 0 else ring[::-1], axis=1))
    squares = np.concatenate(corners)
    vertices, where = np.unique(squares.reshape(-1, 3), axis=0, return_inverse=True)
    a, b, c, d = where.reshape(-1, 4).T
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Mesh(vertices.astype(np.float64), faces.astype(np.int32))


def prism_mesh(outline: Polygon | MultiPolygon, low: float, high: float) -> Mesh:
    """Return the closed surface of an area (holes allowed) extruded from z `low` to `high`."""
    import shapely
    import trimesh

    prisms = []
    for part in shapely.get_parts(outline):
        solid = trimesh.creation.extrude_polygon(part, height=high - low, engine="earcut")
        vertices = np.asarray(solid.vertices, dtype=float) + np.array([0.0, 0.0, low])
        prisms.append(Mesh(vertices, np.asarray(solid.faces, dtype=np.int32)))
    return join(prisms)
