"""YCB objects on tables and on a shelf, from viewpoints and with noise that training has not."""

from __future__ import annotations

import os
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.lib import format as npy

from benchmarks.recognition import trial, ycb_meshes
from semmap.draw.depth_camera import DepthCamera, look_at
from semmap.geometry.mesh import Mesh, join
from semmap.ingest.meshes.mesh_file import read_mesh
from semmap.perception.models import KnownObject, depth_points, train_model
from semmap.perception.placeholders import Placeholder, subtract_placeholder
from semmap.perception.point_cloud import PerceptionError, read_cloud
from semmap.perception.recognition import Scene, recognise, recognise_cluster
from tests.perception.views import cloud_of, solid

NAMES = ("tomato_soup_can", "gelatin_box", "mustard_bottle")


@pytest.fixture(scope="module")
def meshes(worlds: Path) -> dict[str, Mesh]:
    return {name: mesh for name, mesh in ycb_meshes(worlds).items() if name in NAMES}


@pytest.fixture(scope="module")
def models(meshes: dict[str, Mesh]) -> list[KnownObject]:
    return [train_model(name, mesh) for name, mesh in meshes.items()]


@pytest.mark.parametrize("name", NAMES)
def test_an_object_is_recognised_from_any_side(meshes, models, name: str):
    random = np.random.default_rng(11)
    assert [trial(meshes[name], models, random, False)[0] for _ in range(3)] == [name] * 3


def test_a_partly_hidden_object_is_recognised_or_unknown(meshes, models):
    random = np.random.default_rng(11)
    answers = [(name, trial(meshes[name], models, random, True)[0]) for name in NAMES * 2]
    assert sum(name == answer for name, answer in answers) >= 3
    assert all(answer in (name, "unknown", "not found") for name, answer in answers)


def test_an_object_without_a_model_is_unknown(meshes, models):
    random = np.random.default_rng(2)
    others = [model for model in models if model.name != "mustard_bottle"]
    answers = [trial(meshes["mustard_bottle"], others, random, False)[0] for _ in range(3)]
    assert answers == ["unknown"] * 3


@pytest.fixture(scope="module")
def shelf(worlds: Path) -> Mesh:
    (file,) = (worlds / "small_house" / "models").glob("*_ShoeRack_01/meshes/*visual.DAE")
    return read_mesh(file, dae_up_axis=False)


def turned(yaw: float, x: float = 0, y: float = 0, z: float = 0) -> np.ndarray:
    pose = trimesh.transformations.rotation_matrix(yaw, (0, 0, 1))
    pose[:3, 3] = x, y, z
    return pose


def at(mesh: Mesh, pose: np.ndarray) -> Mesh:
    return Mesh(mesh.vertices @ pose[:3, :3].T + pose[:3, 3], mesh.faces)


def test_a_can_in_a_shelf_that_is_not_quite_where_it_is_believed(meshes, models, shelf):
    """The second board of the shelf is at 0.688 m."""
    true = turned(0.6, 1, 0.5)
    can = meshes["tomato_soup_can"]
    stands = true @ turned(0.2, -0.2, 0, 0.688 - can.bounds[0, 2])
    camera = DepthCamera(
        (320, 240),
        (280.0, 280.0, 159.5, 119.5),
        look_at((true @ (0.1, 1.0, 1.0, 1))[:3], (true @ (0, 0, 0.6, 1))[:3]),
    )
    depths, _ = camera.image(join([at(shelf, true), at(can, stands)]).triangles)
    cloud = depth_points(camera, depths + np.random.default_rng(0).normal(0, 0.001, depths.shape))
    solid_shelf = trimesh.Trimesh(shelf.vertices, shelf.faces, process=False)
    surface = trimesh.sample.sample_surface(solid_shelf, 100_000, seed=0)[0]
    believed = np.linalg.inv(camera.pose) @ true @ turned(0.1, 0.06, -0.08)
    placeholder = Placeholder(surface, believed)
    rest = subtract_placeholder(cloud, placeholder)
    off = np.linalg.inv(rest.pose) @ np.linalg.inv(camera.pose) @ true
    assert np.linalg.norm(off[:3, 3]) < 0.004
    assert np.trace(off[:3, :3]) > 1 + 2 * np.cos(0.01)
    found = [f for f in recognise(cloud, models, placeholders=[placeholder]) if f.name is not None]
    assert [f.name for f in found] == ["tomato_soup_can"]
    model = next(model for model in models if model.name == "tomato_soup_can")
    middle = np.array([*(model.points.min(axis=0) + model.points.max(axis=0)) / 2, 1])
    seen = camera.pose @ found[0].pose @ middle
    assert seen == pytest.approx(stands @ middle, abs=0.01)
    with pytest.raises(PerceptionError, match="points are near the believed pose"):
        subtract_placeholder(cloud, Placeholder(surface, believed @ turned(1.5, 30, 0)))


def test_what_no_recogniser_can_use_is_refused(models):
    cloud = cloud_of(solid("sphere", (0.05,)), (1, 0, 0.3))
    scene = Scene(cloud, (1, 0, 0.3))
    with pytest.raises(PerceptionError, match="no model"):
        recognise_cluster(cloud, [], scene)
    with pytest.raises(PerceptionError, match="0 finite points"):
        recognise_cluster(np.full((50, 3), np.nan), models, scene)
    with pytest.raises(PerceptionError, match="the eye is"):
        Scene(cloud, (1, 0))
    with pytest.raises(PerceptionError, match="sheet: the mesh has no volume"):
        train_model("sheet", Mesh(np.eye(3), np.array([[0, 1, 2]], np.int32)))
    wall = solid("cuboid", (3, 0.1, 1))
    with pytest.raises(PerceptionError, match=r"wall is 3\.\d+ m wide"):
        train_model("wall", Mesh(np.array(wall.vertices), np.array(wall.faces, np.int32)))
    with pytest.raises(PerceptionError, match=r"not a finite \(4, 4\)"):
        subtract_placeholder(cloud, Placeholder(cloud, np.eye(3)))


def test_clouds_are_read_from_files(tmp_path: Path):
    points = np.random.default_rng(0).random((40, 3))
    trimesh.PointCloud(points).export(tmp_path / "a.ply")
    np.save(tmp_path / "b.npy", points.reshape(8, 5, 3))
    assert read_cloud(tmp_path / "a.ply") == pytest.approx(points, abs=1e-6)
    assert (read_cloud(tmp_path / "b.npy") == points.reshape(8, 5, 3)).all()
    (tmp_path / "c.ply").write_bytes(b"ply\nnonsense")
    np.save(tmp_path / "d.npy", points[:, :2])
    for name, message in (("c.ply", "cannot be read"), ("d.npy", "shape"), ("e.ply", "not exist")):
        with pytest.raises(PerceptionError, match=message):
            read_cloud(tmp_path / name)


def test_clouds_beyond_the_limit_are_refused_before_they_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sparse, ply = tmp_path / "sparse.npy", tmp_path / "many.ply"
    with sparse.open("wb") as stream:
        header = {"descr": "<f4", "fortran_order": False, "shape": (15_000_000, 3)}
        npy.write_array_header_1_0(stream, header)
        os.truncate(stream.fileno(), stream.tell() + 180_000_000)
    coordinates = "".join(f"property float {axis}\n" for axis in "xyz")
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex 15000000\n{coordinates}end_header\n"
    )
    ply.write_text(head)
    os.truncate(ply, len(head) + 180_000_000)
    for file in (sparse, ply):
        tracemalloc.start()
        with pytest.raises(PerceptionError, match=r"15,000,000 points.*SEMMAP_MAX_CLOUD_POINTS"):
            read_cloud(file)
        assert tracemalloc.get_traced_memory()[1] < 2**20
        tracemalloc.stop()
    monkeypatch.setenv("SEMMAP_MAX_CLOUD_POINTS", "900")
    with pytest.raises(PerceptionError, match="the cloud has 1,000 points"):
        Scene(np.ones((1000, 3)))
