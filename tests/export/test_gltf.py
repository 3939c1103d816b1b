"""A glTF scene: its JSON as the specification has it, and its shapes as trimesh reads them."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh

import semmap
from tests.conftest import MakeDatabase

Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""From glTF's y up to z up: (x, y, z) to (x, -z, y)."""


def document(path: Path) -> dict[str, Any]:
    """The JSON of a GLB or glTF file."""
    data = path.read_bytes()
    if path.suffix == ".glb":
        assert struct.unpack("<4sII", data[:12]) == (b"glTF", 2, len(data))
        data = data[20 : 20 + struct.unpack("<I", data[12:16])[0]]
    made: dict[str, Any] = json.loads(data)
    return made


@pytest.mark.parametrize("ending", [".glb", ".gltf"])
def test_nodes_are_the_holders_and_what_they_hold(
    furnished: semmap.Map, ending: str, tmp_path: Path
) -> None:
    made = document(furnished.export(tmp_path / f"flat{ending}"))
    nodes = {node["name"]: node for node in made["nodes"]}
    above = {
        made["nodes"][child]["name"]: name
        for name, node in nodes.items()
        for child in node.get("children", ())
    }
    for each in furnished:
        assert above[each.name] == (each.holder.name if each.holder else "map")
        extras = nodes[each.name]["extras"]
        assert (extras["kind"], extras.get("type")) == (each.kind, each.type)
        assert extras.get("properties", {}) == each.properties
    assert above["mug7"] == "desk4"
    assert nodes["kitchen"]["extras"]["label"] == "kitchen"
    assert [p.name for p in tmp_path.iterdir()] == [f"flat{ending}"]


def test_shapes_stand_where_the_map_has_them(furnished: semmap.Map, tmp_path: Path) -> None:
    scene = trimesh.load_scene(furnished.export(tmp_path / "flat.glb"))
    seen = set()
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        mesh = scene.geometry[name].copy().apply_transform(transform)
        points = mesh.vertices @ Z_UP.T
        entity = furnished[node]
        seen.add(node)
        if entity.kind in ("room", "region"):
            flat = shapely.union_all(shapely.polygons(points[mesh.faces][:, :, :2]))
            assert shapely.symmetric_difference(flat, entity.geometry).area < 1e-5
            assert np.allclose(points[:, 2], entity.box[2], atol=1e-6)
            assert (mesh.face_normals @ Z_UP.T)[:, 2] == pytest.approx(1)
        else:
            assert np.allclose([*points.min(axis=0), *points.max(axis=0)], entity.box, atol=1e-5)
            assert mesh.volume == pytest.approx(entity.mesh.volume, rel=1e-4)
    assert seen == {
        e.name for e in furnished if e.kind != "connector" and e.box and e.geometry.area
    }


def test_a_mesh_that_many_have_is_written_once(flat: semmap.Map, tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere()
    for number in range(3):
        flat.add_object(f"ball{number}", mesh=ball, pose=(number, 1, 1))
    made = document(flat.export(tmp_path / "flat.glb"))
    meshes = {node["mesh"] for node in made["nodes"] if node["name"].startswith("ball")}
    assert len(meshes) == 1


@pytest.mark.parametrize("ending", [".glb", ".gltf"])
def test_what_has_a_surface_comes_back(furnished: semmap.Map, ending: str, tmp_path: Path) -> None:
    """Kinds, types, labels, properties, frames and floors; single precision is 1e-7 of 8 m."""
    furnished.add_object("turned", type="desk", size=(2, 1, 0.75), pose=(6, 2, 0, 0.5))
    pose = (1, 1, 0, -2)
    furnished.add_object("rack", type="rack_of_ours", size=(1, 1, 1), pose=pose, define=True)
    again = furnished.database.create_map("again")
    again.import_file(furnished.export(tmp_path / f"flat{ending}"), mesh_as="scene")
    seen = {e.name for e in furnished if e.kind != "connector" and e.box and e.geometry.area}
    assert {e.name for e in again if e.kind != "storey"} == seen
    for name in seen:
        old, new = furnished[name], again[name]
        assert (new.kind, new.type, new.label) == (old.kind, old.type, old.label)
        assert new.properties == old.properties
        assert (new.pose.inverse() @ old.pose)[:6] == pytest.approx([0] * 6, abs=1e-6)
        assert shapely.symmetric_difference(new.geometry, old.geometry).area < 1e-5
        assert new.box[2] == pytest.approx(old.box[2], abs=1e-6)
    assert again["turned"].pose.yaw == pytest.approx(0.5, abs=1e-6)
    assert again["turned"].size == pytest.approx((2, 1, 0.75), abs=1e-6)


def test_storeys_come_back_with_what_is_on_them(db: semmap.Database, tmp_path: Path) -> None:
    place = db.create_map("tower")
    for number, z in enumerate((-3.25, 0.15)):
        storey = place.add_storey(f"storey {number}", elevation=z, height=3)
        room = place.add_room(f"hall {number}", shapely.box(0, 0, 9, 6), storey=storey, floor=z)
        assert room.storey == storey
        desk = f"desk {number}"
        place.add_object(desk, type="desk", size=(2, 1, 0.75), pose=(6, 2, z, 0.5))
        place.add_object(f"mug {number}", type="mug", size=(0.1, 0.1, 0.1), on=desk)
    again = db.create_map("again")
    again.import_file(place.export(tmp_path / "tower.glb"))
    assert {s.name: s.pose.z for s in again.storeys} == pytest.approx(
        {"storey 0": -3.25, "storey 1": 0.15}
    )
    for name in (e.name for e in place if e.kind != "storey"):
        assert again[name].storey.name == place[name].storey.name
        assert again[name].holder.name == place[name].holder.name
    assert again["desk 1"].pose.yaw == pytest.approx(0.5)


def test_a_type_that_another_database_lacks_is_noted_or_defined(
    furnished: semmap.Map, make_database: MakeDatabase, tmp_path: Path
) -> None:
    pose = (1, 1, 0, -2)
    furnished.add_object("rack", type="rack_of_ours", size=(1, 1, 1), pose=pose, define=True)
    file = furnished.export(tmp_path / "flat.glb")
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        summary = db.import_file(file, map="a", mesh_as="scene")
        assert "rack: its type 'rack_of_ours' is none that the map has" in str(summary.notes)
        assert db.map("a")["rack"].type is None
        db.import_file(file, map="b", mesh_as="scene", define=True)
        assert db.map("b")["rack"].type == "rack_of_ours"
