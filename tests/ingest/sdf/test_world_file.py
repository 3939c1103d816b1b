"""SDF worlds: what stands where, of which surface, and what is left out."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.ingest.sdf import read_sdf
from semmap.ingest.world import Entry, World, WorldError

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 3 2\nf 1 4 3\nf 1 2 4\nf 2 3 4\n"
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], float)
BOX = "<geometry><box><size>{}</size></box></geometry>"
VISUAL = f'<visual name="v">{BOX.format("1 2 3")}</visual>'
LINK = f'<link name="base">{VISUAL}</link>'


def world_file(folder: Path, inside: str, name: str = "default", version: str = "1.9") -> Path:
    path = folder / "test.world"
    path.write_text(f'<sdf version="{version}"><world name="{name}">{inside}</world></sdf>')
    return path


def model_file(folder: Path, name: str, inside: str) -> Path:
    """A model folder below `folder`, with a tetrahedron as its mesh."""
    (folder / name / "meshes").mkdir(parents=True)
    (folder / name / "meshes" / "solid.obj").write_text(TETRAHEDRON)
    path = folder / name / "model.sdf"
    path.write_text(f'<sdf version="1.9"><model name="{name}">{inside}</model></sdf>')
    return path


def entry(world: World, name: str) -> Entry:
    return next(e for e in world.entries if e.name == name)


def surface(world: World, name: str) -> Mesh:
    """The one mesh of an entry, in the world's frame."""
    found = entry(world, name)
    (shape,) = found.shapes
    assert found.pose is not None
    assert shape.mesh is not None
    return shape.mesh.moved(found.pose)


def read(folder: Path, inside: str, **options: Any) -> World:
    return read_sdf(world_file(folder, inside), **options)


def volume(mesh: Mesh) -> float:
    return float(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume)


# What stands where


def test_poses_and_scales_by_hand(tmp_path: Path) -> None:
    """The model, its link and its visual each turn by a quarter and move; the mesh is scaled."""
    model_file(
        tmp_path / "models",
        "block",
        """<link name="l"><pose>0 0 1 0 0 1.5707963267948966</pose>
          <visual name="v"><pose>1 0 0 0 0 1.5707963267948966</pose><geometry><mesh>
            <uri>model://block/meshes/solid.obj</uri><scale>1 0.5 2</scale>
          </mesh></geometry></visual></link>""",
    )
    world = read(
        tmp_path,
        """<include><uri>model://block</uri>
          <pose>10 20 30 0 0 1.5707963267948966</pose></include>""",
    )
    # scaled: 1 x 1 x 6. Visual: (x, y) -> (1 - y, x). Link: -> (-x, 1 - y), z + 1. World: ->
    # (10 - (1 - y), 20 - x) = (9 + y, 20 - x), z + 31
    np.testing.assert_allclose(surface(world, "block").bounds, [(9, 19, 31), (10, 20, 37)])
    block = entry(world, "block").shapes[0].mesh
    assert block is not None
    np.testing.assert_allclose(
        block.bounds, [(-1, 0, 1), (0, 1, 7)], atol=1e-12, err_msg="in the model's frame"
    )


def test_include_pose_replaces_the_models_own(tmp_path: Path) -> None:
    path = model_file(tmp_path, "desk", LINK)
    path.write_text(path.read_text().replace("<link", "<pose>7 0 0 0 0 0</pose><link", 1))
    world = read(
        tmp_path,
        """<include><uri>model://desk</uri></include>
        <include><name>moved</name><uri>model://desk</uri><pose>0 5 0 0 0 0</pose></include>""",
    )
    np.testing.assert_allclose(surface(world, "desk").bounds.mean(axis=0), (7, 0, 0))
    np.testing.assert_allclose(surface(world, "moved").bounds.mean(axis=0), (0, 5, 0))


def _at(pose: str, name: str = "m", **attributes: str) -> str:
    written = "".join(f' {k}="{v}"' for k, v in attributes.items())
    return f'<model name="{name}"><pose{written}>{pose}</pose>{LINK}</model>'


@pytest.mark.parametrize(
    ("pose", "attributes"),
    [
        ("0 0 0 0 0 90", {"degrees": "true"}),
        ("0 0 0 0 0 0.70710678 0.70710678", {"rotation_format": "quat_xyzw"}),
        ("0 0 0 0 0 2 2", {"rotation_format": "quat_xyzw"}),
        ("0 0 0\n\t0 -0 1.57079632679", {"frame": ""}),
    ],
)
def test_ways_to_write_a_pose(tmp_path: Path, pose: str, attributes: dict[str, str]) -> None:
    world = read(tmp_path, _at(pose, **attributes))
    np.testing.assert_allclose(np.ptp(surface(world, "m").bounds, axis=0), (2, 1, 3), atol=1e-7)


FRAMES = f"""
<frame name="dock"><pose>1 0 0 0 0 1.5707963267948966</pose></frame>
<frame name="berth" attached_to="dock"><pose>0 2 0 0 0 0</pose></frame>
<model name="tower"><pose relative_to="berth">0 0 3 0 0 0</pose>
  <link name="base"><visual name="v">{BOX.format("1 1 1")}</visual></link>
  <link name="arm"><pose relative_to="elbow">0 0 5 0 0 0</pose></link>
  <link name="hand"><pose>9 9 9 0 0 0</pose></link>
  <frame name="tip" attached_to="arm"><pose>0.5 0 0 0 0 0</pose></frame>
  <joint name="elbow" type="fixed"><parent>base</parent><child>hand</child>
    <pose>0 0 1 0 0 0</pose></joint>
  <model name="lamp" placement_frame="foot"><pose relative_to="tip">0 0 0 0 0 0</pose>
    <link name="foot"><pose>0 0 -2 0 0 0</pose></link></model>
</model>
"""


@pytest.mark.parametrize(
    ("relative_to", "expected"),
    [
        ("world", (0, 0, 0)),
        ("dock", (1, 0, 0)),
        ("berth", (-1, 0, 0)),
        ("tower", (-1, 0, 3)),
        ("tower::base", (-1, 0, 3)),
        # in the tower: hand (9, 9, 9), elbow (9, 9, 10), arm (9, 9, 15), tip (9.5, 9, 15)
        ("tower::hand", (-1 - 9, 9, 12)),
        ("tower::elbow", (-10, 9, 13)),
        ("tower::arm", (-10, 9, 18)),
        ("tower::tip", (-10, 9.5, 18)),
        ("tower::lamp", (-10, 9.5, 20)),
        ("tower::lamp::foot", (-10, 9.5, 18)),
    ],
)
def test_relative_to(tmp_path: Path, relative_to: str, expected: tuple[float, ...]) -> None:
    world = read(tmp_path, FRAMES + _at("0 0 0 0 0 0", relative_to=relative_to))
    pose = entry(world, "m").pose
    assert pose is not None
    np.testing.assert_allclose(pose.translation, expected, atol=1e-9)
    assert world.skipped == []


def test_visuals_relative_to_another_frame(tmp_path: Path) -> None:
    model = f"""<model name="m"><link name="a"><pose>5 0 0 0 0 0</pose></link>
      <link name="b"><visual name="v"><pose relative_to="a">0 1 0 0 0 0</pose>
      {BOX.format("1 1 1")}</visual></link></model>"""
    mean = surface(read(tmp_path, model), "m").bounds.mean(axis=0)
    np.testing.assert_allclose(mean, (5, 1, 0))


def test_merged_include_gives_its_frames_to_the_model(tmp_path: Path) -> None:
    model_file(tmp_path, "leg", '<link name="shin"><pose>0 0 4 0 0 0</pose></link>')
    world = read(
        tmp_path,
        f"""<model name="m"><include merge="true"><uri>model://leg</uri>
        <pose>1 0 0 0 0 0</pose></include><link name="knee"><pose relative_to="shin">0 1 0 0 0 0
        </pose>{VISUAL}</link></model>""",
    )
    assert world.skipped == []
    np.testing.assert_allclose(surface(world, "m").bounds.mean(axis=0), (1, 1, 4))


numbers = st.floats(-5, 5, allow_subnormal=False)
poses = st.tuples(numbers, numbers, numbers, numbers, numbers, numbers)


def matrix(pose: tuple[float, ...]) -> NDArray[np.float64]:
    m = np.eye(4)
    m[:3, :3] = Rotation.from_euler("xyz", pose[3:]).as_matrix()
    m[:3, 3] = pose[:3]
    return m


def written(pose: tuple[float, ...]) -> str:
    return f"<pose>{' '.join(map(repr, pose))}</pose>"


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    chain=st.lists(st.tuples(poses, st.booleans()), min_size=1, max_size=5),
    link=poses,
    visual=poses,
    scale=st.tuples(*[st.sampled_from([-2.0, -1.0, 0.5, 1.0, 3.0])] * 3),
)
def test_nested_poses_are_a_product_of_matrices(
    tmp_path: Path,
    chain: list[tuple[tuple[float, ...], bool]],
    link: tuple[float, ...],
    visual: tuple[float, ...],
    scale: tuple[float, ...],
) -> None:
    """Models within models, some put relative to a link of the model around them."""
    (tmp_path / "solid.obj").write_text(TETRAHEDRON)
    inside = f"""<link name="l">{written(link)}<visual name="v">{written(visual)}<geometry><mesh>
        <uri>solid.obj</uri><scale>{" ".join(map(repr, scale))}</scale></mesh></geometry></visual>
        </link>"""
    offset = (0.5, -1.0, 2.0, 0.1, -0.2, 0.3)
    expected = matrix(link) @ matrix(visual)
    for depth, (pose, by_link) in reversed(list(enumerate(chain))):
        text = written(pose)
        expected = matrix(pose) @ expected
        if by_link and depth:
            text = text.replace("<pose>", '<pose relative_to="hook">')
            expected = matrix(offset) @ expected
        inside = f"""<model name="m{depth}">{text}{inside}</model>"""
        if depth:
            inside += f"""<link name="hook">{written(offset)}</link>"""
    found = surface(read(tmp_path, inside), "m0")
    homogeneous = np.c_[CORNERS * scale, np.ones(4)] @ expected.T
    order = np.lexsort(homogeneous[:, :3].round(6).T)
    np.testing.assert_allclose(
        found.vertices[np.lexsort(found.vertices.round(6).T)],
        homogeneous[order, :3],
        atol=1e-9,
    )
    assert volume(found) == pytest.approx(abs(np.prod(scale))), "normals point outward"


# Surfaces


@pytest.mark.parametrize(
    ("shape", "size", "inscribed"),
    [
        ("<box><size>1 2 3</size></box>", (1, 2, 3), 6.0),
        ("<sphere><radius>0.5</radius></sphere>", (1, 1, 1), math.pi / 6),
        ("<ellipsoid><radii>1 2 3</radii></ellipsoid>", (2, 4, 6), 8 * math.pi),
        ("<cylinder><radius>1</radius><length>3</length></cylinder>", (2, 2, 3), 3 * math.pi),
        ("<cone><radius>1</radius><length>3</length></cone>", (2, 2, 3), math.pi),
        (
            "<capsule><radius>1</radius><length>3</length></capsule>",
            (2, 2, 5),
            math.pi * (3 + 4 / 3),
        ),
    ],
)
def test_solids(tmp_path: Path, shape: str, size: tuple[float, ...], inscribed: float) -> None:
    model = f"""<model name="m"><link name="l"><visual name="v"><geometry>{shape}</geometry>
        </visual></link></model>"""
    mesh = surface(read(tmp_path, model), "m")
    np.testing.assert_allclose(mesh.bounds, np.array([(-0.5,) * 3, (0.5,) * 3]) * size, atol=1e-9)
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces)
    assert solid.is_watertight
    assert 0.93 * inscribed < solid.volume <= inscribed * (1 + 1e-9)


def test_polylines_with_a_hole(tmp_path: Path) -> None:
    def ring(low: float, high: float) -> str:
        corners = [(low, low), (high, low), (high, high), (low, high)]
        points = "".join(f"<point>{x} {y}</point>" for x, y in corners)
        return f"<polyline>{points}<height>2</height></polyline>"

    model = f"""<model name="m"><link name="l"><visual name="v">
        <geometry>{ring(0, 4)}{ring(1, 2)}</geometry></visual></link></model>"""
    mesh = surface(read(tmp_path, model), "m")
    np.testing.assert_allclose(mesh.bounds, [(0, 0, 0), (4, 4, 2)])
    assert volume(mesh) == pytest.approx(2 * (16 - 1))


@pytest.mark.parametrize(
    ("normal", "size"), [("0 0 1", (2, 3, 0)), ("0 0 -1", (2, 3, 0)), ("1 0 0", (0, 3, 2))]
)
def test_a_plane_that_is_only_seen_is_a_rectangle(
    tmp_path: Path, normal: str, size: tuple[float, ...]
) -> None:
    model = f"""<model name="poster"><link name="l"><visual name="v"><geometry><plane>
        <normal>{normal}</normal><size>2 3</size></plane></geometry></visual></link></model>"""
    mesh = surface(read(tmp_path, model), "poster")
    np.testing.assert_allclose(np.ptp(mesh.bounds, axis=0), size, atol=1e-12)
    a, b, c = mesh.triangles[0]
    direction = np.cross(b - a, c - a)
    np.testing.assert_allclose(
        direction / np.linalg.norm(direction), [float(v) for v in normal.split()], atol=1e-12
    )


def test_ground_has_no_extent(tmp_path: Path) -> None:
    plane = "<geometry><plane><normal>0 0 1</normal><size>100 100</size></plane></geometry>"
    model = f"""<model name="ground_plane"><static>true</static><link name="l">
        <visual name="v">{plane}</visual><collision name="c">{plane}</collision></link></model>"""
    for geometry in ("visual", "collision"):
        world = read(tmp_path, model, geometry=geometry)
        assert entry(world, "ground_plane").shapes == []
        assert entry(world, "ground_plane").type == "ground"
        assert any("endless plane" in note for note in world.notes)
        assert world.skipped == []


def test_visual_or_collision(tmp_path: Path) -> None:
    model = f"""<model name="m"><link name="l">{VISUAL}<collision name="c">{BOX.format("4 4 4")}
        </collision></link></model>"""
    for geometry, x in (("visual", 1), ("collision", 4)):
        world = read(tmp_path, model, geometry=geometry)
        assert entry(world, "m").shapes[0].role == geometry
        assert np.ptp(surface(world, "m").bounds, axis=0)[0] == x
    with pytest.raises(ValueError, match="visual or collision"):
        read(tmp_path, model, geometry="both")


@pytest.mark.parametrize(
    ("pose", "kind"),
    [
        ("1 2 3 0 0 0", "box"),
        ("0 0 0 0 0 1.5707963267948966", "box"),
        ("0 0 0 0 0 0.1", "mesh"),
    ],
)
def test_a_lone_level_box_is_a_box(tmp_path: Path, pose: str, kind: str) -> None:
    model = f"""<model name="m"><pose>0 0 0 1 1 1</pose><link name="l"><pose>{pose}</pose>
        {VISUAL}</link></model>"""
    assert entry(read(tmp_path, model), "m").shapes[0].kind == kind
    two = model.replace("</link>", VISUAL.replace('"v"', '"w"') + "</link>")
    assert entry(read(tmp_path, two), "m").shapes[0].kind == "mesh"


def test_instances_of_a_model_share_its_mesh(tmp_path: Path) -> None:
    mesh = "<geometry><mesh><uri>meshes/solid.obj</uri></mesh></geometry>"
    model_file(
        tmp_path,
        "desk",
        f'<link name="l"><visual name="a">{mesh}</visual><visual name="b">{mesh}</visual></link>',
    )
    world = read(
        tmp_path,
        """<include><name>a</name><uri>model://desk</uri></include>
        <model name="b"><pose>3 0 0 0 0 1</pose><include><uri>model://desk</uri></include></model>
        <model name="c"><include><uri>model://desk</uri><pose>1 0 0 0 0 0</pose></include></model>
        """,
    )
    a, b, c = (entry(world, name).shapes[0].mesh for name in "abc")
    assert a is b is c
    assert a is not None
    assert len(a.faces) == 8
    assert entry(world, "c").pose == Pose(1, 0, 0)


def test_gltf_is_y_up_and_a_dae_up_axis_is_ignored(tmp_path: Path) -> None:
    solid = trimesh.creation.box(extents=(1, 2, 3))
    solid.export(tmp_path / "a.glb")
    solid.export(tmp_path / "a.dae")
    text = (tmp_path / "a.dae").read_text()
    assert "<up_axis>" in text
    sizes = {}
    for name in ("a.glb", "a.dae"):
        uri = f"<geometry><mesh><uri>{name}</uri></mesh></geometry>"
        model = f'<model name="m"><link name="l"><visual name="v">{uri}</visual></link></model>'
        sizes[name] = np.ptp(surface(read(tmp_path, model), "m").bounds, axis=0).round(6).tolist()
    assert sizes == {"a.glb": [1, 3, 2], "a.dae": [1, 2, 3]}


def test_submesh(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(extents=(1, 1, 1)), "lid", geom_name="lid")
    far = np.eye(4)
    far[0, 3] = 10
    scene.add_geometry(trimesh.creation.box(extents=(2, 2, 2)), "pot", "pot", transform=far)
    scene.export(tmp_path / "a.glb")

    def size(submesh: str) -> NDArray[np.float64]:
        model = f"""<model name="m"><link name="l"><visual name="v"><geometry><mesh>
            <uri>a.glb</uri>{submesh}</mesh></geometry></visual></link></model>"""
        return surface(read(tmp_path, model), "m").bounds

    np.testing.assert_allclose(size(""), [(-0.5, -1, -1), (11, 1, 1)])
    np.testing.assert_allclose(
        size("<submesh><name>pot</name></submesh>"), [(9, -1, -1), (11, 1, 1)]
    )
    np.testing.assert_allclose(
        size("<submesh><name>pot</name><center>true</center></submesh>"), [(-1,) * 3, (1,) * 3]
    )


# Names, types, properties


def test_names_are_made_unique_and_reported(tmp_path: Path) -> None:
    world = read(tmp_path, _at("0 0 0 0 0 0") + _at("1 0 0 0 0 0") + _at("2 0 0 0 0 0"))
    assert [e.name for e in world.entries] == ["m", "m_2", "m_3"]
    assert len(world.notes) == 2
    assert [e.pose.x for e in world.entries if e.pose] == [0, 1, 2]


def test_type_and_properties(tmp_path: Path) -> None:
    model_file(tmp_path / "models", "acme_KitchenTable_01", f"<static>1</static>{LINK}")
    uri = "<uri>model://acme_KitchenTable_01</uri>"
    world = read(
        tmp_path,
        f"""<include>{uri}</include>
        <include><name>free</name>{uri}<static>false</static></include>
        <model name="wrapped"><static>true</static><include>{uri}</include></model>
        <model name="DeskLamp"><static>true</static>{LINK}</model>
        <model name="x7">{LINK}</model>""",
    )
    found = {e.name: (e.type, e.properties) for e in world.entries}
    table = "acme_KitchenTable_01"
    guess = {"type_guess": {"type": "kitchen_table", "confidence": 0.8}}
    lamp = {"type_guess": {"type": "desk_lamp", "confidence": 0.9}}
    assert found == {
        table: ("kitchen_table", {"model": table, "static": True, **guess}),
        "free": ("kitchen_table", {"model": table, "static": False, **guess}),
        "wrapped": ("kitchen_table", {"model": table, "static": True, **guess}),
        "DeskLamp": ("desk_lamp", {"model": "DeskLamp", "static": True, **lamp}),
        "x7": (None, {"model": "x7", "static": False}),
    }


def test_elements_that_are_not_objects_make_no_entry(tmp_path: Path) -> None:
    world = read(
        tmp_path,
        f"""<light name="sun" type="directional"/><plugin name="p" filename="x"/><physics/>
        <gui/><actor name="walker"><pose>1 2 0 0 0 0</pose></actor>{_at("0 0 0 0 0 0")}
        <population name="crowd"/>""",
    )
    assert [(e.name, e.kind) for e in world.entries] == [("m", "object"), ("walker", "agent")]
    assert [s.element for s in world.skipped] == ["population crowd"]


def test_a_model_file_alone(tmp_path: Path) -> None:
    world = read_sdf(model_file(tmp_path, "mug", LINK))
    assert [e.name for e in world.entries] == ["mug"]
    assert world.name == "model"


def test_world_name_and_georeference(tmp_path: Path) -> None:
    earth = """<spherical_coordinates><latitude_deg>49</latitude_deg>
        <longitude_deg>8</longitude_deg></spherical_coordinates>"""
    world = read_sdf(world_file(tmp_path, earth, name="depot"))
    assert world.name == "depot"
    assert world.georeference == {"latitude_deg": 49.0, "longitude_deg": 8.0}
    at_zero = read(tmp_path, earth.replace("49", "0").replace("8", "0"))
    assert (at_zero.name, at_zero.georeference) == ("test", None)


# Where files are found


@pytest.mark.parametrize(
    ("folder", "uri"),
    [
        ("models", "model://desk"),
        ("models", "file://models/desk"),
        (".", "file://desk"),
        ("models", "models/desk"),
        ("worlds/models", "model://desk/model.sdf"),
        (".", "package://test_package/desk"),
    ],
)
def test_uris(tmp_path: Path, folder: str, uri: str) -> None:
    model_file(
        tmp_path / folder,
        "desk",
        """<link name="l"><visual name="v"><geometry><mesh><uri>model://desk/meshes/solid.obj</uri>
        </mesh></geometry></visual></link>""",
    )
    (tmp_path / "worlds").mkdir(exist_ok=True)
    world = read(tmp_path / "worlds", f"<include><uri>{uri}</uri></include>")
    assert world.skipped == []
    assert entry(world, "desk").properties["model"] == "desk"
    np.testing.assert_allclose(surface(world, "desk").bounds, [(0, 0, 0), (1, 2, 3)])


def test_absolute_file_uri(tmp_path: Path) -> None:
    path = model_file(tmp_path / "elsewhere", "desk", LINK)
    (tmp_path / "worlds").mkdir()
    world = read(tmp_path / "worlds", f"<include><uri>file://{path}</uri></include>")
    assert len(entry(world, "desk").shapes) == 1


def test_model_path_comes_first_and_the_environment_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder, sides in (("given", "1 1 1"), ("a/models", "2 2 2"), ("env", "3 3 3")):
        model_file(tmp_path / folder, "cube", LINK.replace("1 2 3", sides))
    monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", str(tmp_path / "env"))
    include = "<include><uri>model://cube</uri></include>"
    (tmp_path / "b").mkdir()

    def size(folder: str, *model_path: Path) -> float:
        world = read(tmp_path / folder, include, model_path=model_path)
        return float(np.ptp(surface(world, "cube").bounds, axis=0)[0])

    assert size("a", tmp_path / "given") == 1
    assert size("a") == 2
    assert size("b") == 3


def test_model_config_names_the_newest_file(tmp_path: Path) -> None:
    folder = model_file(tmp_path, "cube", LINK).parent
    newer = (folder / "model.sdf").read_text().replace("1 2 3", "9 9 9")
    (folder / "model-1_10.sdf").write_text(newer)
    (folder / "model.config").write_text(
        """<model><sdf version="1.10">model-1_10.sdf</sdf><sdf version="1.9">model.sdf</sdf>
        </model>"""
    )
    world = read(tmp_path, "<include><uri>model://cube</uri></include>")
    np.testing.assert_allclose(np.ptp(surface(world, "cube").bounds, axis=0), (9, 9, 9))


# What is left out


MESH = "<geometry><mesh><uri>{}</uri></mesh></geometry>"
OUTLINE = (
    "<polyline><point>0 0</point><point>1 0</point><point>1 1</point><height>1</height></polyline>"
)
CAPSULE = "<geometry><capsule><radius>{}</radius><length>{}</length></capsule></geometry>"
SKIPPED = {
    "missing mesh": (LINK.replace(BOX.format("1 2 3"), MESH.format("model://no.dae")), "not found"),
    "mesh on the network": (
        LINK.replace(BOX.format("1 2 3"), MESH.format("https://example.org/a.dae")),
        "network",
    ),
    "no uri": (LINK.replace(BOX.format("1 2 3"), MESH.format("")), "does not name a file"),
    "odd uri": (LINK.replace(BOX.format("1 2 3"), MESH.format("a&#10;b")), "does not name a file"),
    "not a number": (LINK.replace("1 2 3", "1 two 3"), "3 finite numbers"),
    "NaN": (LINK.replace("1 2 3", "1 nan 3"), "3 finite numbers"),
    "infinite": (LINK.replace("1 2 3", "1 1e999 3"), "3 finite numbers"),
    "too few numbers": (LINK.replace("1 2 3", "1 2"), "3 finite numbers"),
    "no size": (LINK.replace("<size>1 2 3</size>", ""), "missing"),
    "negative size": (LINK.replace("1 2 3", "1 -2 3"), "at least 1e-06 m"),
    "two outlines that cancel": (
        LINK.replace(BOX.format("1 2 3"), "<geometry>" + 2 * OUTLINE + "</geometry>"),
        "cancel out",
    ),
    "flat outline": (
        LINK.replace(
            BOX.format("1 2 3"), f"<geometry>{OUTLINE.replace('>1<', '>1e-9<')}</geometry>"
        ),
        "at least 1e-06 m",
    ),
    "hair-thin capsule": (
        LINK.replace(BOX.format("1 2 3"), CAPSULE.format("1e-9", "1")),
        "at least 1e-06 m",
    ),
    "speck of a capsule": (
        LINK.replace(BOX.format("1 2 3"), CAPSULE.format("1e-6", "1e-6")),
        "too small",
    ),
    "giant": (LINK.replace("1 2 3", "1 2 1e9"), "the limit is 10,000 m"),
    "no geometry": (LINK.replace(BOX.format("1 2 3"), ""), "no geometry"),
    "heightmap": (
        LINK.replace(BOX.format("1 2 3"), "<geometry><heightmap/></geometry>"),
        "not a supported surface",
    ),
    "unknown frame": (
        LINK.replace("<geometry>", '<pose relative_to="x">0 0 0 0 0 0</pose><geometry>'),
        "does not have or cannot place",
    ),
    "NaN pose": (
        LINK.replace("<geometry>", "<pose>0 0 nan 0 0 0</pose><geometry>"),
        "6 finite numbers",
    ),
    "zero quaternion": (
        LINK.replace(
            "<geometry>", '<pose rotation_format="quat_xyzw">0 0 0 0 0 0 0</pose><geometry>'
        ),
        "quaternion is zero",
    ),
    "far away": (LINK.replace("<geometry>", "<pose>0 0 2e4 0 0 0</pose><geometry>"), "reaches"),
    "open outline": (
        LINK.replace(
            BOX.format("1 2 3"),
            "<geometry><polyline><point>0 0</point><height>1</height></polyline></geometry>",
        ),
        "three points",
    ),
}


@pytest.mark.parametrize("case", SKIPPED)
def test_an_unusable_visual_leaves_its_model_without_it(tmp_path: Path, case: str) -> None:
    link, problem = SKIPPED[case]
    world = read(tmp_path, f'<model name="bad">{link}</model>' + _at("0 0 0 0 0 0"))
    (skipped,) = world.skipped
    assert skipped.element.startswith("model bad: link base: visual v")
    assert problem in skipped.problem
    assert skipped.fix
    assert entry(world, "bad").shapes == []
    assert len(entry(world, "m").shapes) == 1


@pytest.mark.parametrize(
    ("model", "problem"),
    [
        (_at("nan 0 0 0 0 0", "bad"), "6 finite numbers"),
        (_at("0 0 0", "bad"), "6 finite numbers"),
        (_at("0 0 343582.9 0 0 0", "bad"), "(0, 0, 343,583) m"),
        (_at("0 0 0 0 0 0", "bad", relative_to="nowhere"), "does not have or cannot place"),
        ("<include><name>bad</name><uri>model://m</uri><pose>1</pose></include>", "6 finite"),
    ],
)
def test_an_instance_without_a_place_is_left_out(tmp_path: Path, model: str, problem: str) -> None:
    model_file(tmp_path, "m", LINK)
    world = read(tmp_path, model + _at("0 0 0 0 0 0", "good"))
    assert [e.name for e in world.entries] == ["good"]
    (skipped,) = world.skipped
    assert "bad" in skipped.element
    assert problem in skipped.problem


def test_a_missing_model_keeps_its_place(tmp_path: Path) -> None:
    world = read(
        tmp_path,
        "<include><uri>model://Desk_01</uri><pose>1 2 3 0 0 0</pose></include>",
    )
    desk = entry(world, "Desk_01")
    assert (desk.type, desk.shapes) == ("desk", [])
    assert "not found" in world.skipped[0].problem


def test_the_other_geometry_stands_in_for_a_missing_one(tmp_path: Path) -> None:
    link = LINK.replace(BOX.format("1 2 3"), MESH.format("no.dae"))
    solid = f'<collision name="c">{BOX.format("4 5 6")}</collision></link>'
    world = read(tmp_path, f'<model name="m">{link.replace("</link>", solid)}</model>')
    assert entry(world, "m").shapes[0].role == "collision"
    np.testing.assert_allclose(np.ptp(surface(world, "m").bounds, axis=0), (4, 5, 6))
    assert len(world.skipped) == 1
    assert "geometry is used" in world.notes[0]


def test_defects_of_a_shared_file_are_reported_once(tmp_path: Path) -> None:
    model_file(tmp_path, "m", LINK.replace(BOX.format("1 2 3"), MESH.format("no.dae")))
    world = read(tmp_path, "<include><uri>model://m</uri></include>" * 3)
    assert len(world.entries) == 3
    assert [s.element for s in world.skipped] == ["m/model.sdf: model m: link base: visual v"]


def test_a_name_that_differs_in_case_is_hinted_at(tmp_path: Path) -> None:
    (tmp_path / "Solid.obj").write_text(TETRAHEDRON)
    link = LINK.replace(BOX.format("1 2 3"), MESH.format("solid.obj"))
    world = read(tmp_path, f'<model name="m">{link}</model>')
    assert "Solid.obj" in world.skipped[0].fix


# What is refused


def test_absent_file(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="cannot be read"):
        read_sdf(tmp_path / "no.world")


LAUGHS = """<!DOCTYPE sdf [<!ENTITY a "haha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;">
<!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;">]><sdf version="1.9"><world name="&c;"/></sdf>"""

REFUSED = {
    "empty": (b"", "not well-formed"),
    "truncated": (b'<sdf version="1.9"><world name="w"><model na', "not well-formed"),
    "not XML": (b"\x89PNG\r\n\x1a\n\0\0\0", "not well-formed"),
    "another root": (b"<robot name='r'/>", "<robot>"),
    "no world": (b'<sdf version="1.9"/>', "no <world>"),
    "bomb": (LAUGHS.encode(), "entities"),
    "document type": (b'<!DOCTYPE sdf SYSTEM "other.dtd"><sdf version="1.9"/>', "document type"),
    "odd encoding": (b"<?xml version='1.0' encoding='utf-99'?><sdf/>", "XML"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_file_that_cannot_be_trusted_is_refused(tmp_path: Path, case: str) -> None:
    data, problem = REFUSED[case]
    path = tmp_path / "bad.world"
    path.write_bytes(data)
    with pytest.raises(WorldError, match=problem) as error:
        read_sdf(path)
    assert "bad.world" in str(error.value)
    assert error.value.element
    assert error.value.fix


BROKEN = {
    "empty": "",
    "truncated": "<sdf",
    "bomb": LAUGHS,
    "another root": "<robot/>",
    "circle": """<sdf version="1.9"><model name="m"><link name="a"><pose relative_to="b"/></link>
        <link name="b"><pose relative_to="a"/></link></model></sdf>""",
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_included_model_is_skipped_by_name(tmp_path: Path, case: str) -> None:
    model_file(tmp_path, "m", LINK).write_text(BROKEN[case])
    place = "<pose>4 5 6 0 0 0</pose>"
    world = read(
        tmp_path,
        f"<include><name>one</name><uri>model://m</uri>{place}</include>"
        f"<include><uri>model://m</uri></include>{_at('0 0 0 0 0 0', 'good')}",
    )
    (skipped,) = world.skipped
    assert skipped.element == "include one"
    assert "model://m cannot be used" in skipped.problem
    assert [(e.name, len(e.shapes)) for e in world.entries] == [("one", 0), ("m", 0), ("good", 1)]
    assert entry(world, "one").pose == Pose(4, 5, 6)


CIRCLES = {
    "frames": """<frame name="a"><pose relative_to="b"/></frame>
        <frame name="b" attached_to="c"/><frame name="c"><pose relative_to="a"/></frame>""",
    "models": _at("0 0 0 0 0 0", "a", relative_to="b") + _at("0 0 0 0 0 0", "b", relative_to="a"),
    "itself": _at("0 0 0 0 0 0", "a", relative_to="a"),
    "inner": """<model name="m"><link name="a"><pose relative_to="b"/></link>
        <link name="b"><pose relative_to="a"/></link></model>""",
    "through a model": """<frame name="a"><pose relative_to="m::l"/></frame>
        <model name="m"><pose relative_to="a">0 0 0 0 0 0</pose><link name="l"/></model>""",
}


@pytest.mark.parametrize("case", CIRCLES)
def test_circles_of_frames_are_refused(tmp_path: Path, case: str) -> None:
    with pytest.raises(WorldError, match="relative to itself") as error:
        read(tmp_path, CIRCLES[case])
    assert " -> " in str(error.value)


def test_circles_of_includes_are_cut_and_named(tmp_path: Path) -> None:
    for one, other in (("a", "b"), ("b", "a")):
        model_file(tmp_path, one, f"<include><uri>model://{other}</uri></include>")
    world = read(tmp_path, "<include><uri>model://a</uri></include>")
    (skipped,) = world.skipped
    assert skipped.element == "a/model.sdf: include b"
    assert "leads back to model.sdf, which includes this file" in skipped.problem
    assert entry(world, "a").shapes == []


def test_endless_nesting_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="nests models: 65 levels, the limit is 64 levels"):
        read(tmp_path, '<model name="m">' * 2000 + "</model>" * 2000)


def test_a_bomb_of_includes_is_cut_where_it_exceeds_the_limit(tmp_path: Path) -> None:
    """Ten files, each with ten of the next: 10^10 boxes."""
    model_file(tmp_path, "m0", LINK)
    for level in range(1, 10):
        uri = f"<uri>model://m{level - 1}</uri>"
        includes = "".join(f"<include><name>i{n}</name>{uri}</include>" for n in range(10))
        model_file(tmp_path, f"m{level}", includes)
    world = read(tmp_path, "<include><uri>model://m9</uri></include>")
    (skipped,) = world.skipped
    assert skipped.element == "m6/model.sdf: include i0"
    assert "has 100,000 parts, the limit is 20,000 parts" in skipped.problem
    assert entry(world, "m9").shapes == []


# What Gazebo loads


LOADED = {
    "dashes in a comment": "<sdf version='1.9'><!-- a -- b --->{}</sdf>",
    "comment before the declaration": "<!----><?xml version='1.0'?><sdf version='1.9'>{}</sdf>",
    "blank before the declaration": "\n <?xml version='1.0'?>\n<sdf version='1.9'>{}</sdf>",
    "undeclared prefix": "<sdf version='1.9'>{}<gz:dynamic_detachable gz:kind='x'/></sdf>",
    "lone ampersand": "<sdf version='1.9'>{}<author>A & B</author></sdf>",
    "obsolete root": "<gazebo version='1.2'>{}</gazebo>",
    "byte order mark": "\ufeff<!-- -- --><sdf version='1.9'>{}</sdf>",
}


@pytest.mark.parametrize("case", LOADED)
def test_what_gazebo_loads_is_read(tmp_path: Path, case: str) -> None:
    """TinyXML2 reads all of these; strict XML allows none of them."""
    path = tmp_path / "lax.world"
    path.write_text(LOADED[case].format(f"<world name='w'>{_at('1 2 3 0 0 0')}</world>"))
    world = read_sdf(path)
    assert entry(world, "m").pose == Pose(1, 2, 3)
    assert len(entry(world, "m").shapes) == 1
    assert world.skipped == []


def test_errors_of_lax_files_name_the_line_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "lax.world"
    path.write_text("<!-- a\n -- b -->\n<?xml version='1.0'?>\n<sdf>\n<world></wrong></sdf>")
    with pytest.raises(WorldError, match=r"lax\.world: line 5"):
        read_sdf(path)


def test_the_notation_of_the_obsolete_root(tmp_path: Path) -> None:
    """SDF 1.0 has attributes for elements of today: unread, all models stand at the origin."""
    path = tmp_path / "old.world"
    path.write_text(
        """<gazebo version="1.0"><world name="w"><model name="crate" static="true">
        <origin pose="1 2 3 0 0 0"/><link name="l"><visual name="v"><origin pose="0 0 1 0 0 0"/>
        <geometry><box size="1 2 4"/></geometry></visual></link></model></world></gazebo>"""
    )
    world = read_sdf(path)
    assert world.skipped == []
    assert entry(world, "crate").properties["static"] is True
    np.testing.assert_allclose(surface(world, "crate").bounds, [(0.5, 1, 2), (1.5, 3, 6)])


def test_a_wrapped_include_has_its_place_and_shares_its_mesh(tmp_path: Path) -> None:
    """`<model><include><pose/></include></model>`, as Gazebo's editor nests what it groups."""
    model_file(tmp_path, "desk", LINK)
    wrapped = "".join(
        f"""<model name="desk_{n}"><static>true</static><pose>0 0 {n} 0 0 0</pose>
        <include><uri>model://desk</uri><pose>{n} 2 0 0 0 1.5707963267948966</pose></include>
        </model>"""
        for n in range(20)
    )
    world = read(tmp_path, wrapped)
    assert [e.name for e in world.entries] == [f"desk_{n}" for n in range(20)]
    for n, e in enumerate(world.entries):
        assert e.pose is not None
        np.testing.assert_allclose((e.pose.x, e.pose.y, e.pose.z, e.pose.yaw), (n, 2, n, np.pi / 2))
        assert (e.type, e.properties["model"], e.properties["static"]) == ("desk", "desk", True)
        np.testing.assert_allclose(surface(world, e.name).bounds.mean(axis=0), (n, 2, n), atol=1e-9)
    assert len({id(e.shapes[0].mesh) for e in world.entries}) == 1


def test_a_wrapped_include_without_its_mesh_keeps_its_place(tmp_path: Path) -> None:
    model_file(tmp_path, "pump", LINK.replace(BOX.format("1 2 3"), MESH.format("no.dae")))
    inner = "<include><uri>model://{}</uri><pose>1 2 3 0 0 0</pose></include>"
    world = read(
        tmp_path,
        "".join(f"<model name='{m}_1'>{inner.format(m)}</model>" for m in ("pump", "nowhere")),
    )
    assert [(e.name, e.pose, e.shapes) for e in world.entries] == [
        ("pump_1", Pose(1, 2, 3), []),
        ("nowhere_1", Pose(1, 2, 3), []),
    ]
    assert len(world.skipped) == 2


def test_a_sun_is_not_an_object(tmp_path: Path) -> None:
    """Neither the one of Gazebo's library, which may be missing, nor one beside the world."""
    include = "<include><uri>model://{}</uri></include>"
    world = read(tmp_path, include.format("sun") + _at("0 0 0 0 0 0"))
    assert ([e.name for e in world.entries], world.skipped) == (["m"], [])
    (tmp_path / "daylight").mkdir()
    (tmp_path / "daylight" / "model.sdf").write_text("<sdf version='1.9'><light name='l'/></sdf>")
    world = read(tmp_path, include.format("daylight") + _at("0 0 0 0 0 0"))
    assert ([e.name for e in world.entries], world.skipped) == (["m"], [])


@pytest.mark.parametrize(
    ("stated", "mass"),
    [
        ("<inertial><mass>0.4</mass></inertial>", 0.4),
        ("", None),
        ("<inertial/>", None),
        ("<inertial><mass>nan</mass></inertial>", None),
    ],
)
def test_the_mass_that_links_state(tmp_path: Path, stated: str, mass: float | None) -> None:
    shape = "<visual name='v'><geometry><box><size>1 1 1</size></box></geometry></visual>"
    link = f"<link name='{{}}'>{stated}{shape}</link>"
    model = f"<model name='m'>{link.format('a')}<model name='n'>{link.format('b')}</model></model>"
    world = read(tmp_path, model)
    expected = None if mass is None else pytest.approx(2 * mass)
    assert entry(world, "m").properties.get("mass") == expected
    assert entry(world, "m").properties["static"] is False
