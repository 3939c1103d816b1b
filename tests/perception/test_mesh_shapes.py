"""Shapes of whole meshes: solids of trimesh, YCB objects of known sizes, furniture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from semmap.ingest.meshes.mesh_file import read_mesh
from semmap.perception.mesh_shapes import mesh_primitive
from semmap.perception.point_cloud import PerceptionError
from tests.perception.views import solid

TILTED = trimesh.transformations.rotation_matrix(0.7, (1, 2, 0.5))
TILTED[:3, 3] = 0.3, -2, 1


@pytest.mark.parametrize(
    ("kind", "size"),
    [
        ("sphere", (0.07,)),
        ("cylinder", (0.04, 0.12)),
        ("cone", (0.06, 0.15)),
        ("cuboid", (0.1, 0.2, 0.05)),
    ],
)
def test_a_solid_is_its_own_shape(kind, size):
    found = mesh_primitive(solid(kind, size, TILTED))
    assert found.kind == kind
    assert sorted(found.size) == pytest.approx(sorted(size), rel=0.02)
    assert found.inliers > 0.97
    same = solid(kind, found.size, found.pose)
    assert same.bounds == pytest.approx(solid(kind, size, TILTED).bounds, abs=0.004)


def test_a_handle_does_not_widen_a_mug():
    body = solid("cylinder", (0.04, 0.1))
    handle = trimesh.creation.torus(0.025, 0.005)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    handle.apply_translation((0.045, 0, 0))
    found = mesh_primitive(trimesh.util.concatenate([body, handle]))
    assert found.kind == "cylinder"
    assert found.size == pytest.approx((0.04, 0.1), abs=0.002)
    assert 0.6 < found.inliers < 0.97


@pytest.mark.parametrize(
    ("name", "kind", "sizes"),
    [  # as the YCB set states them, metres
        ("003_cracker_box", "cuboid", (0.060, 0.158, 0.210)),
        ("004_sugar_box", "cuboid", (0.038, 0.089, 0.175)),
        ("005_tomato_soup_can", "cylinder", (0.033, 0.101)),
        ("009_gelatin_box", "cuboid", (0.028, 0.073, 0.085)),
    ],
)
def test_ycb_objects_have_the_shapes_and_sizes_of_the_set(worlds: Path, name, kind, sizes):
    mesh = read_mesh(worlds / "ycb" / "meshes" / f"{name}_textured.gltf")
    found = mesh_primitive(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))
    assert found.kind == kind
    assert sorted(found.size) == pytest.approx(sizes, abs=0.006)


@pytest.mark.parametrize(("name", "kind"), [("Ball_01", "sphere"), ("Wardrobe_01", "cuboid")])
def test_objects_of_the_small_house(worlds: Path, name: str, kind: str):
    (file,) = (worlds / "small_house" / "models").glob(f"*_{name}/meshes/*visual.DAE")
    mesh = read_mesh(file, dae_up_axis=False)
    found = mesh_primitive(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))
    assert found.kind == kind
    assert found.inliers > 0.95


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (trimesh.Trimesh(), "no surface"),
        (trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), "flat"),
        (
            trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [np.nan, 1, 0]], [[0, 1, 2]], process=False),
            "no s",
        ),
        (trimesh.Trimesh(np.zeros((3, 3)), [[0, 1, 2]], process=False), "no surface"),
    ],
)
def test_meshes_of_no_volume_are_refused(mesh, message):
    with pytest.raises(PerceptionError, match=message):
        mesh_primitive(mesh)
