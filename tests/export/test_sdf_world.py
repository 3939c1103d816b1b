"""SDF worlds: models stand where the map has them, and what a simulator changes counts."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import semmap
from tests.command_line import semmap as semmap_cli
from tests.export.comparison import differences


def test_models_are_meshes_at_poses(furnished: semmap.Map, tmp_path: Path) -> None:
    world = ElementTree.parse(furnished.export(tmp_path / "flat.sdf")).find("world")
    seen = set()
    for model in world.findall("model"):
        numbers = np.array(model.findtext("pose").split(), float)
        for role in ("visual", "collision"):
            uri = model.findtext(f"link/{role}/geometry/mesh/uri")
            mesh = trimesh.load_mesh(tmp_path / uri)
            points = Rotation.from_quat(numbers[3:]).apply(mesh.vertices) + numbers[:3]
            box = furnished[model.get("name")].box
            assert np.allclose([*points.min(axis=0), *points.max(axis=0)], box, atol=1e-6)
        seen.add(model.get("name"))
        assert model.findtext("static") == str(model.get("name") != "robot1").lower()
    assert seen == {e.name for e in furnished if e.kind in ("object", "agent") and e.size}


def test_what_a_simulator_changed_counts(
    furnished: semmap.Map, db: semmap.Database, tmp_path: Path
) -> None:
    path = furnished.export(tmp_path / "flat.sdf")
    tree = ElementTree.parse(path)
    world = tree.find("world")
    models = {model.get("name"): model for model in world.findall("model")}
    models["ell"].find("pose").text = "6.2 0.2 0 0 0 0 1"
    world.remove(models["tilted"])
    models["mug7"].set("name", "cup")  # a model that no feature names
    tree.write(path)
    again = db.create_map("again")
    summary = again.import_file(path)
    assert {each.problem for each in summary.skipped} == {"its model is not in the world"}
    assert again["ell"].pose[:3] == pytest.approx((6.2, 0.2, 0))
    moved = again["ell"].geometry.symmetric_difference(furnished["ell"].geometry)
    assert moved.area > 0.1
    assert again["ell"].geometry.area == pytest.approx(furnished["ell"].geometry.area)
    names = {each.name for each in again}
    assert "cup" in names
    assert not names & {"tilted", "mug7"}


def test_a_damaged_element_is_refused(furnished: semmap.Map, tmp_path: Path) -> None:
    path = furnished.export(tmp_path / "flat.sdf")
    path.write_text(path.read_text().replace('{"type": "FeatureCollection"', '{"type', 1))
    with pytest.raises(semmap.Error, match="features: is not JSON"):
        furnished.database.import_file(path, map="again")


def test_a_missing_mesh_is_named(furnished: semmap.Map, tmp_path: Path) -> None:
    path = furnished.export(tmp_path / "flat.geojson")
    (tmp_path / "flat_meshes" / "ell.obj").unlink()
    summary = furnished.database.import_file(path, map="again")
    (left,) = summary.skipped
    assert left.problem == "its mesh flat_meshes/ell.obj does not exist"


def test_meshes_can_be_left_out(furnished: semmap.Map, tmp_path: Path) -> None:
    path = furnished.export(tmp_path / "flat.geojson", meshes=False)
    assert [p.name for p in tmp_path.iterdir()] == ["flat.geojson"]
    again = furnished.database.create_map("again")
    assert again.import_file(path).skipped == []
    wrong = differences(furnished, again, meshes=False)
    assert all(each.startswith("tilted: pose") for each in wrong)
    assert again["mug7"].mesh.volume > furnished["mug7"].mesh.volume * 0.99


def test_the_command_writes_what_the_method_does(
    flat: semmap.Map, database: str, tmp_path: Path
) -> None:
    path = tmp_path / "flat.geojson"
    shown = semmap_cli(database, "export", str(path), "--json")
    assert json.loads(shown.stdout) == str(path)
    one = path.read_text()
    assert flat.export(tmp_path / "flat.geojson").read_text() == one
    with pytest.raises(ValueError, match=r"a map is exported to \.gpkg"):
        semmap_cli(database, "export", str(tmp_path / "flat.dxf"))
    with pytest.raises(ValueError, match="has no georeference"):
        semmap_cli(database, "export", str(path), "--crs", "4326")
