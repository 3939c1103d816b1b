"""URDF scenes: poses and surfaces as yourdfpy places them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yourdfpy
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import semmap
from semmap.ingest.importer import read_world
from semmap.ingest.scenes.urdf_scene import read_urdf_scene
from semmap.ingest.world import WorldError
from tests.ingest.scenes.placed import box, entry, points, pose
from tests.ingest.sdf.worlds_by_hand import CORNERS, TETRAHEDRON
from tests.robot.robots import real_robot

KITCHEN = """<robot name="kitchen">
  <link name="world"/>
  <link name="cabinet">
    <visual><origin xyz="0 0 0.45"/><geometry><box size="0.6 1.2 0.9"/></geometry></visual>
    <collision><geometry><box size="9 9 9"/></geometry></collision>
  </link>
  <link name="hinge"/>
  <link name="cabinet_door">
    <visual><origin xyz="0 0.3 0" rpy="0.1 0.2 0.3"/>
      <geometry><mesh filename="solid.obj" scale="0.1 0.1 -0.1"/></geometry></visual>
  </link>
  <link name="mug">
    <collision><geometry><cylinder radius="0.04" length="0.1"/></geometry></collision>
    <visual><geometry><mesh filename="package://lost/mug.dae"/></geometry></visual></link>
  <joint name="a" type="fixed"><parent link="world"/><child link="cabinet"/>
    <origin xyz="2 1 0" rpy="0 0 1.2"/></joint>
  <joint name="b" type="fixed"><parent link="cabinet"/><child link="hinge"/>
    <origin xyz="0.3 -0.6 0.5"/></joint>
  <joint name="c" type="revolute"><parent link="hinge"/><child link="cabinet_door"/>
    <origin xyz="0 0 0.1" rpy="0.3 0 0"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="2" effort="1" velocity="1"/></joint>
  <joint name="d" type="floating"><parent link="cabinet"/><child link="mug"/>
    <origin xyz="0 0 0.95"/></joint>
</robot>"""


def written(folder: Path, text: str = KITCHEN) -> Path:
    (folder / "solid.obj").write_text(TETRAHEDRON)
    path = folder / "kitchen.urdf"
    path.write_text(text)
    return path


def oracle(path: Path) -> yourdfpy.URDF:
    return yourdfpy.URDF.load(str(path), load_meshes=False, filename_handler=lambda name: name)


def test_links_stand_where_yourdfpy_has_them(tmp_path: Path) -> None:
    path = written(tmp_path)
    world = read_urdf_scene(path)
    assert world.name == "kitchen"
    assert {e.name: e.holder for e in world.entries} == {
        "cabinet": None,
        "cabinet_door": "cabinet",
        "mug": "cabinet",
    }
    urdf = oracle(path)
    for made in world.entries:
        expected = urdf.get_transform(made.name, "world")
        np.testing.assert_allclose(pose(world, made.name).matrix, expected, atol=1e-9)
    visual = urdf.link_map["cabinet_door"].visuals[0].origin
    placed = urdf.get_transform("cabinet_door", "world") @ visual
    expected = (0.1 * CORNERS * (1, 1, -1)) @ placed[:3, :3].T + placed[:3, 3]
    found = points(world, "cabinet_door")
    assert np.abs(found[:, None] - expected).sum(axis=2).min(axis=1).max() < 1e-9
    assert len(found) == len(expected)
    assert entry(world, "cabinet").type == "cabinet"
    assert np.ptp(box(world, "cabinet")[:, 2]) == pytest.approx(0.9)
    (skipped,) = world.skipped
    assert skipped.element.startswith("link mug: visual")
    assert "--model-path" in skipped.fix
    solid = read_urdf_scene(path, geometry="collision")
    assert np.ptp(box(solid, "cabinet")[:, 2]) == pytest.approx(9)


def test_meshes_are_found_in_packages_of_ros(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ws" / "share" / "lost").mkdir(parents=True)
    (tmp_path / "ws" / "share" / "lost" / "mug.obj").write_text(TETRAHEDRON)
    path = written(tmp_path, KITCHEN.replace("mug.dae", "mug.obj"))
    assert len(read_urdf_scene(path).skipped) == 1
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path / 'ws'}")
    world = read_urdf_scene(path)
    assert world.skipped == []
    assert np.ptp(box(world, "mug")[:, 2]) == pytest.approx(3)


def test_a_link_without_its_mesh_keeps_its_pose(tmp_path: Path, database: str) -> None:
    lost = '<geometry><mesh filename="package://lost/door.dae"/></geometry>'
    path = written(tmp_path, re.sub(r'<geometry><mesh filename="solid.*</geometry>', lost, KITCHEN))
    world = read_urdf_scene(path)
    door = entry(world, "cabinet_door")
    assert (door.shapes, door.holder) == ([], "cabinet")
    expected = oracle(path).get_transform("cabinet_door", "world")
    np.testing.assert_allclose(pose(world, "cabinet_door").matrix, expected, atol=1e-9)
    assert "link cabinet_door: visual" in {s.element for s in world.skipped}
    with semmap.connect(database) as db:
        summary = db.import_file(path, map="kitchen")
        assert summary.no_geometry == ["cabinet_door"]
        assert any("--model-path" in note for note in summary.notes)
        assert db.map("kitchen")["cabinet_door"].holder == db.map("kitchen")["cabinet"]


numbers = st.floats(-3, 3)
origins = st.tuples(numbers, numbers, numbers, numbers, numbers, numbers)


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.lists(st.tuples(origins, st.integers(0, 100), st.booleans()), min_size=1, max_size=7))
def test_chains_of_joints(tmp_path: Path, joints) -> None:
    shape = '<visual><geometry><sphere radius="0.1"/></geometry></visual>'
    text = f'<link name="l0">{shape}</link>'
    for k, (origin, above, solid) in enumerate(joints, 1):
        xyz, rpy = (" ".join(map(str, part)) for part in (origin[:3], origin[3:]))
        text += (
            f'<link name="l{k}">{shape if solid else ""}</link><joint name="j{k}" type="fixed">'
            f'<parent link="l{above % k}"/><child link="l{k}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/></joint>'
        )
    path = written(tmp_path, f'<robot name="r">{text}</robot>')
    world, urdf = read_urdf_scene(path), oracle(path)
    assert {e.name for e in world.entries} == {
        "l0",
        *(f"l{k}" for k, j in enumerate(joints, 1) if j[2]),
    }
    for made in world.entries:
        expected = urdf.get_transform(made.name, "l0")
        np.testing.assert_allclose(pose(world, made.name).matrix, expected, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not well-formed"),
        (KITCHEN[:900], "not well-formed"),
        ("<mujoco/>", "not the expected root, <robot>"),
        ("<robot name='r'/>", "its links have 0 roots"),
        ("<robot name='r'><link name='a'/></robot>", "no node has a surface"),
        (
            KITCHEN.replace('child link="mug"', 'child link="cup"'),
            "there is no link 'cup'",
        ),
        (
            KITCHEN.replace('child link="mug"', 'child link="hinge"'),
            "has another joint above",
        ),
        (KITCHEN.replace('xyz="2 1 0"', 'xyz="2 nan 0"'), "joint a"),
        (KITCHEN.replace('parent link="world"', 'parent link="hinge"'), "roots|circle"),
    ],
)
def test_bad_files_are_refused_by_name(text: str, message: str, tmp_path: Path) -> None:
    path = written(tmp_path, text)
    with pytest.raises(WorldError, match=message) as refused:
        read_world(path)
    assert str(path) in str(refused.value)


def test_a_real_robot() -> None:
    path = real_robot("tiago")
    world = read_urdf_scene(path)
    assert world.skipped == []
    urdf = oracle(path)
    assert len(world.entries) > 20
    for made in world.entries:
        expected = urdf.get_transform(made.name, urdf.base_link)
        np.testing.assert_allclose(pose(world, made.name).matrix, expected, atol=1e-6)
