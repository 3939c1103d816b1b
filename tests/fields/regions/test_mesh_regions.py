"""Meshes as regions: shells with thin walls keep them."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from semmap.fields.regions.mesh_regions import mesh_parts
from semmap.fields.regions.shaped_region import Solid, SurfaceRegion, voxels_of
from semmap.geometry.mesh import Mesh


def crate(wall: float) -> Mesh:
    """An open crate of 0.4 m, watertight, its walls of one thickness."""
    outer = trimesh.creation.box((0.4, 0.4, 0.4))
    inner = trimesh.creation.box((0.4 - 2 * wall, 0.4 - 2 * wall, 0.4))
    inner.apply_translation((0, 0, wall))
    made = trimesh.boolean.difference([outer, inner], engine="manifold")
    made.apply_transform(trimesh.transformations.rotation_matrix(0.7, (1, 2, 3)))
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


@pytest.mark.parametrize("wall", [0.004, 0.02])
def test_thin_walls_have_no_holes(wall: float) -> None:
    mesh = crate(wall)
    regions = mesh_parts(mesh).regions(0.05)
    assert [type(r) for r in regions] == [Solid, SurfaceRegion]
    filled = {tuple(v) for r in regions for v in voxels_of(r, 0.05)}
    points = trimesh.Trimesh(mesh.vertices, mesh.faces).sample(20_000, seed=1)
    assert {tuple(v) for v in np.floor(points / 0.05).astype(int)} <= filled
    assert (0, 0, 0) not in filled


def test_thick_walls_and_solids_have_the_voxels_of_their_centres() -> None:
    assert [type(r) for r in mesh_parts(crate(0.1)).regions(0.05)] == [Solid]
    ball = trimesh.creation.icosphere(radius=0.06)
    made = mesh_parts(Mesh(np.asarray(ball.vertices), np.asarray(ball.faces))).regions(0.05)
    assert [type(r) for r in made] == [Solid]


def test_a_pose() -> None:
    pose = np.eye(4)
    pose[:3, 3] = (1, 2, 3)
    parts = mesh_parts(crate(0.1))
    (moved,) = parts.regions(0.05, pose)
    (still,) = parts.regions(0.05)
    shifted = np.add(voxels_of(still, 0.05), (20, 40, 60))
    assert {tuple(v) for v in voxels_of(moved, 0.05)} == {tuple(v) for v in shifted}
