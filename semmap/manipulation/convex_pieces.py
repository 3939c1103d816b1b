"""The convex pieces of which a simulation takes an object to be made (CoACD: Wei et al. 2022).

The hull of a mug is solid: no finger gets into it, and it has no handle to be held by.
"""

from __future__ import annotations

from contextlib import suppress
from functools import lru_cache

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from semmap.arrays import Floats
from semmap.geometry.mesh import Mesh
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.extra import library
from semmap.manipulation.solids import solid_hull

HOLLOW, FILLED = 0.01, 0.02
"""Metres from hull to mesh, and the share of the hull so far away, from which pieces are cut."""

SAMPLES = 10_000
"""Points by which a mesh is compared with its hull."""

CONCAVITY = 0.05
"""The concavity of pieces that CoACD does not cut further."""


def convex_pieces(mesh: Mesh) -> tuple[Mesh, ...]:
    """Convex meshes that make up a mesh, as near as some per cent; its hull where that is as near.

    The pieces of a mesh are the same in each run. Those of a mug take 4 to 20 s; they are kept for
    the process. Raises ManipulationError where the mesh has no volume.
    """
    return _pieces(
        np.ascontiguousarray(mesh.vertices).tobytes(),
        np.ascontiguousarray(mesh.faces, np.int32).tobytes(),
    )


@lru_cache(maxsize=16)
def _pieces(vertices: bytes, faces: bytes) -> tuple[Mesh, ...]:
    mesh = trimesh.Trimesh(
        np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(faces, np.int32).reshape(-1, 3)
    )
    whole = _hull(np.asarray(mesh.vertices)[np.unique(mesh.faces)])
    if not _is_hollow(mesh, whole):
        return (whole,)
    coacd = library("coacd")
    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        coacd.Mesh(mesh.vertices, mesh.faces),
        threshold=CONCAVITY,
        preprocess_resolution=30,
        resolution=1000,
        mcts_nodes=10,
        mcts_iterations=60,
        decimate=True,
        max_ch_vertex=64,
        seed=0,
    )
    pieces = []
    for part in parts:
        with suppress(ManipulationError):  # a flat one
            pieces.append(_hull(part[0]))
    return tuple(pieces) or (whole,)


def _hull(points: Floats) -> Mesh:
    """The convex hull of points (N, 3); ManipulationError where they have no volume."""
    solid_hull(points)
    hull = trimesh.convex.convex_hull(points)
    return Mesh(np.asarray(hull.vertices, np.float64), np.asarray(hull.faces, np.int32))


def _is_hollow(mesh: trimesh.Trimesh, whole: Mesh) -> bool:
    """Whether a part of the hull is far from the mesh: what the hull fills, such as a mouth."""
    points, spacing = _even(mesh)
    of_hull, _ = _even(trimesh.Trimesh(whole.vertices, whole.faces))
    away = cKDTree(points).query(of_hull)[0]
    return bool((away > max(HOLLOW, 3 * spacing)).mean() > FILLED)


def _even(mesh: trimesh.Trimesh) -> tuple[Floats, float]:
    """Points on a mesh, and the metres that they are apart."""
    points = np.asarray(trimesh.sample.sample_surface(mesh, SAMPLES, seed=0)[0])
    return points, float(np.sqrt(mesh.area / SAMPLES))
