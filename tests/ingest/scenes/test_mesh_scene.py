"""A scene in one file: an object for each named node, and rooms and routes from it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

import semmap
from semmap.ingest.importer import read_world
from semmap.ingest.scenes.mesh_scene import read_mesh_scene

BOXES = {
    "Wall_south": ((0, 0, 0), (8, 0.2, 2.7)),
    "Wall_north": ((0, 4, 0), (8, 4.2, 2.7)),
    "Wall_west": ((0, 0.2, 0), (0.2, 4, 2.7)),
    "Wall_east": ((7.8, 0.2, 0), (8, 4, 2.7)),
    "Wall_a": ((3.9, 0.2, 0), (4.1, 1.5, 2.7)),
    "Wall_b": ((3.9, 2.5, 0), (4.1, 4, 2.7)),
    "Bed": ((0.6, 1, 0), (2.4, 2, 0.5)),
    "Stove.001": ((7, 0.3, 0), (7.6, 0.9, 0.9)),
    "Mug": ((7.2, 0.5, 0.9), (7.3, 0.6, 1.0)),
}
"""Lowest and highest corners, metres, z up."""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """The boxes as nodes of a GLB file, whose y is up; each node is moved, its mesh is not."""
    made = trimesh.Scene()
    up = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    for name, (low, high) in BOXES.items():
        size = np.subtract(high, low)
        place = trimesh.transformations.translation_matrix(np.add(low, high) / 2)
        box = trimesh.creation.box(size)
        made.add_geometry(box, node_name=name, geom_name=f"mesh of {name}", transform=up @ place)
    path = tmp_path / "flat.glb"
    made.export(path)
    return path


def test_each_named_node_is_an_object_where_it_is(scene: Path) -> None:
    world = read_mesh_scene(scene)

    found = {entry.name: entry for entry in world.entries}
    assert set(found) == set(BOXES)
    for name, (low, high) in BOXES.items():
        entry = found[name]
        assert entry.pose is not None
        mesh = entry.shapes[0].mesh
        assert mesh is not None
        placed = mesh.vertices + entry.pose.translation
        assert placed.min(axis=0) == pytest.approx(low, abs=1e-6)
        assert placed.max(axis=0) == pytest.approx(high, abs=1e-6)
        assert mesh.vertices[:, 2].min() == pytest.approx(0, abs=1e-6)
    assert [found[n].type for n in ("Wall_a", "Bed", "Mug")] == ["wall", "bed", "mug"]


def test_a_scene_gets_rooms_and_a_route(scene: Path, database: str) -> None:
    with semmap.connect(database) as db:
        summary = db.import_file(scene, map="flat")
        assert "a scene of named nodes" in " ".join(summary.notes)
        flat = db.map("flat")
        assert flat["Mug"].holder == flat["Stove.001"]

        flat.find_rooms(add=True)

        assert {room.type for room in flat.rooms} == {"bedroom", "kitchen"}
        assert flat["Bed"].room is not None
        assert flat.route(flat["Bed"].room, "Mug").metres > 2
        again = db.import_file(scene, map="flat", mesh_as="scene")
        assert (again.added, again.changed, again.removed) == (0, 0, 0)


def test_a_large_file_of_one_node_is_one_object_with_its_name(tmp_path: Path) -> None:
    made = trimesh.Scene()
    made.add_geometry(trimesh.creation.box((8, 8, 3)), node_name="node", geom_name="mesh")
    made.export(tmp_path / "hall.glb")
    world = read_world(tmp_path / "hall.glb")
    assert ([entry.name for entry in world.entries], world.notes) == (["hall"], [])


@pytest.mark.parametrize(("scale", "as_scene"), [(0.25, False), (1.0, True)])
def test_furniture_of_several_nodes_is_one_object_unless_it_is_large(
    scene: Path, scale: float, as_scene: bool
) -> None:
    """Two metres of a cupboard with named doors, and eight of a flat, in the same file."""
    world = read_world(scene, scale=scale)
    assert len(world.entries) == (len(BOXES) if as_scene else 1)
    assert len(read_world(scene, mesh_as="scene", scale=scale).entries) == len(BOXES)
    assert len(read_world(scene, mesh_as="object", scale=scale).entries) == 1
