"""Meshes as regions: solids where they are closed, surfaces where they are open or thin-walled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semmap.fields.regions.shapes import Region, Solid, Surface
from semmap.geometry.mesh import Mesh
from semmap.geometry.parts import closed_parts

__all__ = ["Parts", "parts_of"]


@dataclass(frozen=True, eq=False)
class Parts:
    """A mesh whose corners within a micrometre are one.

    Attributes
    ----------
    closed : (F,) whether a face is of a closed part, which has an inside
    wall : (F,) metres, how thick the walls of a face's part are on the whole; infinite for what is
        no shell
    """

    mesh: Mesh
    closed: NDArray[np.bool_]
    wall: NDArray[np.float64]

    def regions(self, voxel_size: float, pose: NDArray[np.float64] | None = None) -> list[Region]:
        """What the closed parts enclose, and the surfaces of the others and of thin walls.

        A wall thinner than a voxel could lie between centres, so that its surface counts, too.

        Parameters
        ----------
        voxel_size : metres
        pose : (4, 4) of the mesh in the frame of the regions; none if it is the same
        """
        vertices = self.mesh.vertices
        if pose is not None:
            vertices = vertices @ pose[:3, :3].T + pose[:3, 3]
        drawn = ~self.closed | (self.wall < voxel_size)
        found: list[Region] = []
        if self.closed.any():
            found.append(Solid(vertices, self.mesh.faces[self.closed]))
        if drawn.any():
            found.append(Surface(vertices, self.mesh.faces[drawn]))
        return found


def parts_of(mesh: Mesh) -> Parts:
    """Which parts of a mesh have an inside, and how thick they are."""
    corners, number = np.unique(np.round(mesh.vertices, 6), axis=0, return_inverse=True)
    merged = Mesh(corners, number.reshape(-1)[mesh.faces].astype(np.int32))
    part, closed = closed_parts(merged)
    if not len(part):
        return Parts(merged, np.zeros(0, np.bool_), np.zeros(0))
    return Parts(merged, closed[part], _walls(merged, part)[part])


def _walls(mesh: Mesh, part: NDArray[np.int32]) -> NDArray[np.float64]:
    """(parts,) twice volume by area, of parts that fill less than a quarter of their box."""
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
