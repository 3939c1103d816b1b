"""SDF worlds: what stands where, of which surface, and under which name."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from semmap.geometry.pose import Pose
from semmap.ingest.sdf.world_file import read_sdf
from tests.ingest.sdf.worlds_by_hand import (
    BOX,
    CORNERS,
    LINK,
    TETRAHEDRON,
    VISUAL,
    at,
    entry,
    model_file,
    read,
    surface,
    volume,
    world_file,
)

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
    world = read(tmp_path, at(pose, **attributes))
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
    world = read(tmp_path, FRAMES + at("0 0 0 0 0 0", relative_to=relative_to))
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
    world = read(tmp_path, at("0 0 0 0 0 0") + at("1 0 0 0 0 0") + at("2 0 0 0 0 0"))
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
        <gui/><actor name="walker"><pose>1 2 0 0 0 0</pose></actor>{at("0 0 0 0 0 0")}
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
