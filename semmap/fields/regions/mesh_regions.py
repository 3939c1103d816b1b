"""Meshes as regions: closed parts as solids, open and thin-walled parts as surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semmap.fields.regions.shaped_region import Region, Solid, SurfaceRegion
from semmap.geometry.mesh import Mesh
from semmap.geometry.parts import closed_parts


@dataclass(frozen=True, eq=False)
class MeshParts:
    """A mesh, and which of its parts are closed."""

    mesh: Mesh  # corners within a micrometre are merged
    closed: NDArray[np.bool_]  # (F,) whether a face belongs to a closed part, which has an inside
    # (F,) the mean wall thickness of the part of a face in metres; infinite where the part is not a
    # shell
    wall: NDArray[np.float64]

    def regions(self, voxel_size: float, pose: NDArray[np.float64] | None = None) -> list[Region]:
        """Return the inside of closed parts, and the surface of the others, at a pose (4, 4).

        The surface of a closed part with walls thinner than a voxel is returned, too: such a wall
        could lie between the centres of voxels.
        """
        vertices = self.mesh.vertices
        if pose is not None:
            vertices = vertices @ pose[:3, :3].T + pose[:3, 3]
        drawn = ~self.closed | (self.wall < voxel_size)
        found: list[Region] = []
        if self.closed.any():
            found.append(Solid(vertices, self.mesh.faces[self.closed]))
        if drawn.any():
            found.append(SurfaceRegion(vertices, self.mesh.faces[drawn]))
        return found


def mesh_parts(mesh: Mesh) -> MeshParts:
    """Return which parts of a mesh are closed, and how thick their walls are."""
    corners, number = np.unique(np.round(mesh.vertices, 6), axis=0, return_inverse=True)
    merged = Mesh(corners, number.reshape(-1)[mesh.faces].astype(np.int32))
    part, closed = closed_parts(merged)
    if not len(part):
        return MeshParts(merged, np.zeros(0, np.bool_), np.zeros(0))
    return MeshParts(merged, closed[part], _wall_thickness(merged, part)[part])


def _wall_thickness(mesh: Mesh, part: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return 2 * volume / area of each part that fills less than a quarter of its box: (parts,)."""
    triangles = mesh.triangles
    count = part.max() + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, part, triangles.min(axis=1))
    np.maximum.at(high, part, triangles.max(axis=1))
    a, b, c = np.moveaxis(triangles - low[part][:, None], 1, 0)
    cross = np.cross(b - a, c - a)
    area = np.bincount(part, np.linalg.norm(cross, axis=1)) / 2
    volume = np.abs(np.bincount(part, np.einsum("ij,ij->i", a, cross))) / 6
    shell = volume < np.prod(high - low, axis=1) / 4
    return np.where(shell, 2 * volume / np.maximum(area, 1e-300), np.inf)
