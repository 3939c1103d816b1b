"""A scene in one file: an object for each named node, and rooms and routes from it."""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path

import numpy as np
import pytest
import trimesh

import semmap
from semmap.ingest.importer import MeshAs, read_world
from semmap.ingest.scenes.mesh_scene import read_mesh_scene
from tests.ingest.scenes import placed
from tests.ingest.scenes.placed import box, points, pose

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


def obj_text(objects: list[tuple[str, float]], before_faces: str = "") -> str:
    """Tetrahedra with a corner at x, each below the statement with which it begins."""
    text = ""
    for number, (statement, x) in enumerate(objects):
        corners = "".join(f"v {x + dx} {dy} {dz}\n" for dx, dy, dz in CORNERS)
        first = 4 * number + 1
        faces = "".join("f" + "".join(f" {first + k}" for k in face) + "\n" for face in FACES)
        text += f"{statement}\n{corners}{before_faces}{faces}"
    return text


CORNERS = ((0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3))
FACES = ((0, 2, 1), (0, 3, 2), (0, 1, 3), (1, 2, 3))


def places(path: Path) -> list[tuple[str, str | None, float, int]]:
    """Name, type, middle in x, and number of triangles of each object, by its middle."""
    found = []
    world = read_mesh_scene(path)
    for entry in world.entries:
        mesh = entry.shapes[0].mesh
        assert mesh is not None
        found.append((entry.name, entry.type, pose(world, entry.name).x, len(mesh.faces)))
    return sorted(found, key=lambda each: each[2])


@pytest.mark.parametrize("material", ["", "usemtl oak\n"])
@pytest.mark.parametrize("keyword", ["o", "g", "  o ", "o\t"])
def test_each_object_of_an_obj_file_is_one(keyword: str, material: str, tmp_path: Path) -> None:
    path = tmp_path / "flat.obj"
    names = [(f"{keyword} {name}", x) for name, x in [("Table", 0), ("Chair", 10), ("world", 20)]]
    path.write_text("mtllib none.mtl\n" + obj_text(names, material))
    assert places(path) == [
        ("Table", "table", 0.5, 4),
        ("Chair", "chair", 10.5, 4),
        ("world", None, 20.5, 4),
    ]


def test_objects_of_an_obj_file_with_groups_materials_and_one_name(tmp_path: Path) -> None:
    """Materials and groups divide no object; two objects of one name stay two."""
    path = tmp_path / "flat.obj"
    legs = "f 1 2 3\nusemtl steel\ng legs\nf 1 2 4\n"
    path.write_text(obj_text([("o Chair", 0)], f"usemtl oak\n{legs}") + obj_text([("o Chair", 10)]))
    assert [(name, x) for name, _, x, _ in places(path)] == [("Chair", 0.5), ("Chair_2", 0.5)]
    path.write_text("v 0 0 0\nv 4 0 0\nv 0 4 0\ng a\nf 1 2 3\ng b\nf 1 2 3\ng a\nf 3 2 1\n")
    assert [(name, faces) for name, _, _, faces in places(path)] == [("a", 2), ("b", 1)]


def test_corners_counted_backwards_are_those_before_the_face(tmp_path: Path) -> None:
    path = tmp_path / "flat.obj"
    text = ""
    for name, x in (("Bed", 0), ("Desk", 10)):
        text += f"o {name}\nv {x} 0 0\nv {x + 2} 0 0\nv {x + 2} \\\n2 0\nv {x} 2 0\nvn 0 0 1\n"
        text += "f -4//-1 -3//-1 -2//-1 -1//-1\n"
    path.write_text(text)
    assert places(path) == [("Bed", "bed", 1.0, 2), ("Desk", "desk", 11.0, 2)]


DAE = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.5"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g" name="solid"><mesh>
  <source id="p"><float_array id="a" count="12">0 0 0 1 0 0 0 2 0 0 0 3</float_array>
    <technique_common><accessor source="#a" count="4" stride="3"><param name="X" type="float"/>
      <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>
  </source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  <triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/>
    <p>0 2 1 0 3 2 0 1 3 1 2 3</p></triangles></mesh></geometry></library_geometries>
<library_nodes><node id="seat" name="Stool"><translate>1 0 0</translate>
  <instance_geometry url="#g"/></node></library_nodes>
<library_visual_scenes><visual_scene id="s">
  <node id="z" name="Table"><instance_geometry url="#g"/>
    <node><translate>2 0 0</translate><instance_geometry url="#g"/></node></node>
  <node id="b" name="Chair"><translate>20 0 0</translate><instance_geometry url="#g"/>
    <node id="c" name="Cup"><translate>10 0 0</translate><instance_geometry url="#g"/></node></node>
  <node id="d" name="Chair"><scale>2 1 1</scale><translate>20 0 0</translate>
    <instance_geometry url="#g"/></node>
  <node id="first"><translate>50 0 0</translate><instance_node url="#seat"/></node>
  <node id="second"><translate>60 0 0</translate><instance_node url="#seat"/></node>
  <node><translate>70 0 0</translate><instance_geometry url="#g"/></node>
  <node><translate>80 0 0</translate><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def test_nodes_of_a_collada_file_that_share_a_geometry_are_objects_each(tmp_path: Path) -> None:
    """Middles by hand: half of (translation, plus half a unit times the scale)."""
    path = tmp_path / "flat.dae"
    path.write_text(DAE)
    assert places(path) == [
        ("Table", "table", 0.75, 8),
        ("Chair", "chair", 10.25, 4),
        ("Cup", "cup", 15.25, 4),
        ("Chair_2", "chair", 20.5, 4),
        ("Stool", "stool", 25.75, 4),
        ("Stool_2", "stool", 30.75, 4),
        ("solid", None, 35.25, 4),
        ("solid_2", None, 40.25, 4),
    ]
    holders = {e.name: e.holder for e in read_mesh_scene(path).entries if e.holder}
    assert holders == {"Cup": "Chair"}


def test_primitives_of_a_gltf_node_are_one_object_but_not_its_children(tmp_path: Path) -> None:
    corners = np.array(CORNERS, np.float32)
    buffer = base64.b64encode(corners.tobytes() + np.array(FACES, np.uint16).tobytes()).decode()
    primitive = {"attributes": {"POSITION": 0}, "indices": 1}
    path = tmp_path / "flat.gltf"
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": f"data:;base64,{buffer}", "byteLength": 72}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 24},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [primitive]}, {"primitives": [primitive] * 2}],
        "nodes": [
            {"name": "Table", "children": [1, 2]},
            {"name": "Table_lamp", "mesh": 0},
            {"name": "Cup", "mesh": 1},
            {"name": "world_map", "mesh": 0},
        ],
        "scenes": [{"nodes": [0, 3]}],
    }
    path.write_text(json.dumps(document))
    found = {(name, faces) for name, _, _, faces in places(path)}
    assert found == {("Table_lamp", 4), ("Cup", 8), ("world_map", 4)}


def test_a_node_is_held_by_the_one_above_it_unless_the_geometry_contradicts(
    tmp_path: Path, database: str
) -> None:
    """A book in a shelf, below a node without a mesh; a vase was moved out of it to the floor."""
    made = trimesh.Scene()
    up = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])

    def add(name: str, above: str | None, low: tuple[float, ...], high: tuple[float, ...]) -> None:
        middle = np.add(low, high) / 2
        place = up @ trimesh.transformations.translation_matrix(middle)
        if above is not None:  # of a node that stands elsewhere, and is turned by `up` already
            place = np.linalg.inv(made.graph[above][0]) @ place
        mesh = trimesh.creation.box(np.subtract(high, low))
        made.add_geometry(
            mesh, node_name=name, geom_name=f"of {name}", parent_node_name=above, transform=place
        )

    add("Floor", None, (0, 0, -0.1), (8, 6, 0))
    add("Shelf", None, (1, 1, 0), (2, 1.4, 1.8))
    made.graph.update("Books", "Shelf", matrix=np.eye(4))
    add("Book", "Books", (1.2, 1.1, 1.8), (1.25, 1.3, 2.0))
    add("Vase", "Shelf", (5, 4, 0), (5.2, 4.2, 0.4))
    path = tmp_path / "flat.glb"
    made.export(path)

    world = read_mesh_scene(path)
    holders = {e.name: e.holder for e in world.entries if e.holder}
    assert holders == {"Book": "Shelf", "Vase": "Shelf"}
    assert box(world, "Book") == pytest.approx(np.array([[1.2, 1.1, 1.8], [1.25, 1.3, 2.0]]))
    with semmap.connect(database) as db:
        db.import_file(path, map="nested")
        nested = db.map("nested")
        assert nested["Book"].holder == nested["Shelf"]
        assert nested["Vase"].holder != nested["Shelf"]
        nested["Shelf"].move_to(3, 3, 0)
        assert nested["Book"].box[:3] == pytest.approx((2.7, 2.9, 1.8), abs=1e-6)


@pytest.mark.parametrize(
    ("scale", "mesh_as", "across"),
    [
        (0.001, "scene", "0.008 m"),  # the flat is 8 m long, by BOXES
        (0.06, "scene", "0.48 m"),
        (0.07, "scene", None),
        (24.9, "scene", None),  # no wall is longer than 200 m, nor is the flat than 2 km
        (0.001, "object", "0.008 m"),
        (0.06, "object", None),  # a thing of this size is none the less one
        (0.06, "room", "0.48 m"),
    ],
)
def test_a_whole_scene_of_another_size_than_buildings_is_noted(
    scene: Path, scale: float, mesh_as: MeshAs, across: str | None
) -> None:
    notes = [n for n in read_world(scene, mesh_as=mesh_as, scale=scale).notes if "across" in n]
    assert [note.partition(" across")[0] for note in notes] == (
        [] if across is None else [f"the whole file is {across}"]
    )


def test_a_site_of_more_than_two_kilometres_is_noted(tmp_path: Path) -> None:
    path = tmp_path / "flat.obj"
    for x, noted in ((1900, False), (2100, True)):
        path.write_text(obj_text([("o Table", 0), ("o Chair", x)]))
        assert (f"the whole file is {x + 1} m across" in str(read_world(path).notes)) == noted


def test_an_instance_of_a_library_has_the_name_of_the_node_that_places_it(tmp_path: Path) -> None:
    """But for one of several below a node, which would be one object; places are by hand."""
    box = trimesh.creation.box((1, 1, 1))
    points = " ".join(f"{v:g}" for v in box.vertices.ravel())
    corners = " ".join(map(str, box.faces.ravel()))
    file = tmp_path / "rows.dae"
    file.write_text(
        f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="pa"
 count="24">{points}</float_array><technique_common><accessor source="#pa" count="8" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor></technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/>
</vertices><triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>{corners}</p>
</triangles></mesh></geometry></library_geometries>
<library_nodes><node id="lc" name="cnode"><instance_geometry url="#g"/></node></library_nodes>
<library_visual_scenes><visual_scene id="s">
<node id="a" name="chair_a"><translate>6 0 0</translate><instance_node url="#lc"/></node>
<node id="b" name="chair_b"><translate>1 7 0</translate><instance_node url="#lc"/></node>
<node id="c" name="row"><node name="sofa"><translate>3 0 0</translate><instance_node url="#lc"/>
</node><instance_node url="#lc"/></node>
</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
    )
    world = read_mesh_scene(file)
    found = {e.name: (e.type, round(e.pose.x, 6), round(e.pose.y, 6)) for e in world.entries}
    assert found == {
        "chair_a": ("chair", 6, 0),
        "chair_b": ("chair", 1, 7),
        "sofa": ("sofa", 3, 0),
        "cnode": (None, 0, 0),
    }


@pytest.mark.parametrize(("up", "noted"), [("y", True), ("z", False)])
def test_walls_that_lie_are_noted(tmp_path: Path, up: str, noted: bool) -> None:
    """OBJ does not say which axis is up; z is taken."""
    path = tmp_path / "house.obj"
    parts = trimesh.Scene()
    for name, (wide, deep, high) in {"wall_a": (8, 0.2, 2.6), "wall_b": (0.2, 5, 2.6)}.items():
        size = (wide, high, deep) if up == "y" else (wide, deep, high)
        parts.add_geometry(trimesh.creation.box(size), node_name=name, geom_name=name)
    parts.export(path)
    notes = [n for n in read_mesh_scene(path).notes if "if y is up in house.obj" in n]
    assert len(notes) == noted


Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""From glTF's y up to z up."""


def turn(angle: float, axis: tuple[int, int, int]) -> np.ndarray:
    return trimesh.transformations.rotation_matrix(angle, axis)


def shift(*by: float) -> np.ndarray:
    return trimesh.transformations.translation_matrix(by)


def scaled(*by: float) -> np.ndarray:
    return np.diag([*by, 1.0])


def sheared() -> np.ndarray:
    made = np.eye(4)
    made[0, 1] = 0.5
    return made


TURN = {
    "turned": (turn(0.5, (0, 0, 1)), 0.5, (2, 1, 0.75)),
    "turned and scaled": (turn(-2.6, (0, 0, 1)) @ scaled(0.5, 2, 4), -2.6, (1, 2, 3)),
    "mirrored": (turn(0.7, (0, 0, 1)) @ scaled(1, -1, 1), 0.7, (2, 1, 0.75)),
    "on its side": (turn(0.4, (0, 0, 1)) @ turn(np.pi / 2, (1, 0, 0)), 0.4, (2, 0.75, 1)),
    "on its end": (turn(0.4, (0, 0, 1)) @ turn(-np.pi / 2, (0, 1, 0)), 0.4, None),
    "tilted": (turn(0.5, (0, 0, 1)) @ turn(0.2, (1, 0, 0)), 0.0, None),
    "sheared": (turn(0.5, (0, 0, 1)) @ sheared(), 0.0, None),
}
"""A node's transform, the heading of its object, and the size of that of a box of 2, 1, 0.75 m."""


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("case", TURN)
def test_an_object_has_the_heading_of_its_node(case: str, up: str, tmp_path: Path) -> None:
    """Meshes with z up below a turned root, and with y up; trimesh says where vertices are."""
    transform, heading, size = TURN[case]
    made = trimesh.Scene()
    mesh = trimesh.creation.box((2, 1, 0.75)).apply_translation([0.3, 0, 0.375])
    made.graph.update("root", "world", matrix=np.linalg.inv(Z_UP) @ shift(4, 3, 0))
    if up == "y":  # the same object, the other mesh
        mesh.apply_transform(np.linalg.inv(Z_UP))
        transform = transform @ Z_UP
    made.add_geometry(mesh, node_name="Desk", geom_name="d", parent_node_name="root")
    made.graph.update("Desk", "root", matrix=shift(1, 2, 0.1) @ transform)
    cup = trimesh.creation.box((0.2, 0.1, 0.1))
    made.add_geometry(cup, node_name="Cup", geom_name="c", parent_node_name="Desk")
    made.export(tmp_path / "flat.glb")
    world = read_mesh_scene(tmp_path / "flat.glb")

    found = pose(world, "Desk")
    around = np.pi / 2 if case == "on its end" else 2 * np.pi  # y of one mesh is z of the other
    assert math.remainder(found.yaw - heading, around) == pytest.approx(0, abs=1e-6)
    assert (found.qx, found.qy) == (0, 0)
    graph = trimesh.load_scene(tmp_path / "flat.glb")
    for name in ("Desk", "Cup"):
        matrix, of = graph.graph[name]
        there = trimesh.transform_points(graph.geometry[of].vertices, Z_UP @ matrix)
        here = points(world, name)
        assert np.abs(here[:, None] - there).max(axis=2).min(axis=0).max() < 1e-6
        assert np.abs(here[:, None] - there).max(axis=2).min(axis=1).max() < 1e-6
    (shape,) = placed.entry(world, "Desk").shapes
    assert shape.mesh is not None
    low, high = shape.mesh.bounds
    assert [*(low + high)[:2], low[2]] == pytest.approx([0, 0, 0], abs=1e-6)
    if size is not None:
        assert high - low == pytest.approx(size, abs=1e-6)


def test_an_object_of_a_collada_file_has_the_heading_of_its_node(tmp_path: Path) -> None:
    """A named node is turned by 30 degrees; one without a name in it by 60 more is a part of it."""
    whole = '<node id="z" name="Table"><instance_geometry url="#g"/>'
    part = '<node><translate>2 0 0</translate><instance_geometry url="#g"/></node>'
    text = DAE.replace(whole, whole.replace("<inst", "<rotate>0 0 1 30</rotate><inst"))
    text = text.replace(part, part.replace("<translate>", "<rotate>0 0 1 60</rotate><translate>"))
    (tmp_path / "flat.dae").write_text(text)
    world = read_mesh_scene(tmp_path / "flat.dae")
    assert pose(world, "Table").yaw == pytest.approx(np.pi / 6)
    assert pose(world, "Chair").yaw == 0
    first = 0.5 * np.array(CORNERS) @ turn(np.pi / 6, (0, 0, 1))[:3, :3].T
    second = 0.5 * np.add(CORNERS, (2, 0, 0)) @ turn(np.pi / 2, (0, 0, 1))[:3, :3].T
    there, here = np.vstack([first, second]), points(world, "Table")
    assert np.abs(here[:, None] - there).max(axis=2).min(axis=0).max() < 1e-6


def test_extras_of_other_programs_state_nothing(tmp_path: Path) -> None:
    made = trimesh.Scene()
    box = trimesh.creation.box((1, 1, 1))
    odd = [{"kind": "thing"}, {"kind": "object", "type": 3}, {"kind": "object", "label": "\0"}]
    for number, extras in enumerate([*odd, {"kind": "object", "properties": [1]}, {}]):
        made.add_geometry(box, node_name=f"Chair_{number}", transform=shift(2 * number, 0, 0))
        made.graph.transforms.edge_data[("world", f"Chair_{number}")]["metadata"] = extras
    made.export(tmp_path / "flat.glb")
    world = read_mesh_scene(tmp_path / "flat.glb")
    assert [(e.kind, e.type) for e in world.entries] == [("object", "chair")] * 5
