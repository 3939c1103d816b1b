"""What SPARQL says is near agrees with distances between dense points on the surfaces."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import trimesh
from scipy.spatial import cKDTree
from sqlalchemy import Engine

import semmap

EDGE = 0.1
"""The longest edge of a triangle, metres: any of its points is EDGE / sqrt(3) from a corner."""


def test_near_is_the_distance_between_surfaces(house: Engine) -> None:
    with semmap.connect(house.url.render_as_string(hide_password=False)) as database:
        place = database.map("house")
        meshes = {e.name: e.mesh for e in place.objects if e.mesh is not None}
        rows = place.sparql("SELECT ?a ?b { ?a semmap:near ?b }").rows
        names = [tuple(str(end).rpartition("#")[2] for end in row) for row in rows]
    near = {pair for pair in names if meshes.keys() >= {*pair}}
    trees = {name: cKDTree(dense(mesh)) for name, mesh in meshes.items()}
    slack, unsure = 2 * EDGE / 3**0.5, 0
    for a, b in combinations(meshes, 2):
        assert ((a, b) in near) == ((b, a) in near)
        gap = np.maximum(meshes[a].bounds[0], meshes[b].bounds[0])
        gap -= np.minimum(meshes[a].bounds[1], meshes[b].bounds[1])
        if np.linalg.norm(gap.clip(0)) > 1:
            assert (a, b) not in near
            continue
        few, many = sorted((trees[a], trees[b]), key=lambda tree: tree.n)
        most = many.query(few.data, distance_upper_bound=1 + slack)[0].min()
        if most <= 1 or most - slack > 1:
            assert ((a, b) in near) == (most <= 1), f"{a} and {b} are about {most} m apart"
        else:
            unsure += 1
    assert len(near) > 500
    assert unsure < 20, unsure


def dense(mesh: trimesh.Trimesh) -> np.ndarray:
    """(N, 3) corners of the triangles, cut to edges of `EDGE`."""
    points, _ = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, EDGE, max_iter=20)
    return points
