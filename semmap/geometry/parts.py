"""The connected parts of a mesh, and whether each has an inside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import semmap_native
from semmap.geometry.mesh import Mesh


def closed_as_whole(mesh: Mesh) -> bool:
    """Whether the surface, with equal corners as one, has an inside as for `navgrid.slabs`."""
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    faces = np.ascontiguousarray(mesh.faces, np.int32)
    return bool(semmap_native.closed_solids(vertices, faces, None, 1, 1)[0])


def closed_parts(mesh: Mesh) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Return the part (F,) of each face, and (parts,) whether that part has an inside.

    Faces are connected by corners that are equal within a micrometre. A closed part has each of its
    edges as often in one direction as in the other.
    """
    if not len(mesh.faces):
        return np.zeros(0, np.int32), np.zeros(0, bool)
    corners, number = np.unique(np.round(mesh.vertices, 6), axis=0, return_inverse=True)
    faces = np.ascontiguousarray(number.reshape(-1)[mesh.faces], np.int32)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    graph = coo_array((np.ones(len(edges), bool), edges.T), shape=(len(corners),) * 2)
    label = connected_components(graph, directed=False)[1][faces[:, 0]]
    used, inverse = np.unique(label, return_inverse=True)
    part = np.ascontiguousarray(inverse, np.int32)
    return part, semmap_native.closed_solids(corners, faces, part, len(used), 1)
