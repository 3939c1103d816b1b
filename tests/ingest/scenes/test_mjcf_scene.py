"""MuJoCo scenes: poses as MuJoCo computes them, and surfaces at these poses."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import semmap
from semmap.ingest.importer import read_world
from semmap.ingest.scenes.mjcf_scene import read_mjcf
from semmap.ingest.world import World, WorldError
from tests.ingest.scenes.placed import box, entry, points, pose
from tests.ingest.sdf.worlds_by_hand import CORNERS, TETRAHEDRON

SCENE = """<mujoco model="flat">
  <compiler angle="degree"/>
  <asset>
    <mesh name="solid" file="solid.obj" scale="0.1 0.1 0.1"/>
    <hfield name="hill" nrow="3" ncol="4" size="2 1 0.5 0.1" elevation="0 0 0 0  0 1 1 0  0 0 0 0"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="endless" type="plane" size="0 0 1"/>
    <geom name="floor" type="plane" size="4 3 0.1"/>
    <geom name="wall" type="box" size="4 0.1 1.25" pos="0 3 1.25"/>
    <geom name="terrain" type="hfield" hfield="hill" pos="9 0 0"/>
    <geom type="mesh" mesh="solid" pos="1 1 0" euler="0 0 90"/>
    <body name="room_frame" pos="1 0 0" euler="0 0 30">
      <body name="table" pos="0 1 0">
        <joint type="hinge" ref="40" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/>
        <geom type="box" size="0.6 0.4 0.02" pos="0 0 0.73"/>
        <geom type="cylinder" size="0.05 0.36" pos="0 0 0.36"/>
        <body name="frame_of_mug" pos="0.2 0.1 0.75">
          <body name="mug" euler="0 20 0">
            <geom name="shell" type="mesh" mesh="solid" contype="0" conaffinity="0" pos="0 0 0.01"/>
            <geom name="hull" type="sphere" group="3" size="0.3"/>
          </body>
        </body>
      </body>
    </body>
    <body pos="-2 0 0.5"><geom name="ball" type="ellipsoid" size="0.1 0.2 0.3"/></body>
    <body name="post"><geom type="capsule" size="0.05" fromto="-3 0 0.05 -3 0 1"/></body>
  </worldbody>
</mujoco>
"""


def written(folder: Path, text: str = SCENE) -> Path:
    (folder / "solid.obj").write_text(TETRAHEDRON)
    path = folder / "flat.xml"
    path.write_text(text)
    return path


def simulated(path: Path) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def same_poses(world: World, path: Path) -> set[str]:
    """The bodies that are entries; all have the position and orientation of mj_forward."""
    model, data = simulated(path)
    bodies = {model.body(k).name: k for k in range(1, model.nbody) if model.body(k).name}
    found = {e.name for e in world.entries} & bodies.keys()
    for name in found:
        here = pose(world, name)
        np.testing.assert_allclose(here.translation, data.xpos[bodies[name]], atol=1e-9)
        turn = data.xmat[bodies[name]].reshape(3, 3)
        np.testing.assert_allclose(here.rotation_matrix, turn, atol=1e-9)
    return found


def test_each_body_with_geoms_is_an_object_where_mujoco_has_it(tmp_path: Path) -> None:
    path = written(tmp_path)
    world = read_mjcf(path)
    assert world.name == "flat"
    assert same_poses(world, path) == {"table", "mug", "post"}
    assert {e.name for e in world.entries} == {
        *("floor", "wall", "terrain", "solid", "table", "mug", "body5", "post")
    }
    assert (entry(world, "mug").holder, entry(world, "table").holder) == ("table", None)
    assert [entry(world, n).type for n in ("floor", "wall", "table", "mug")] == [
        *("floor", "wall", "table", "mug")
    ]
    (skipped,) = world.skipped
    assert skipped.element == "geom endless"
    assert "without end" in skipped.problem


def test_surfaces_are_those_of_the_file(tmp_path: Path) -> None:
    path = written(tmp_path)
    world = read_mjcf(path)
    model, data = simulated(path)
    np.testing.assert_allclose(box(world, "floor"), [(-4, -3, 0), (4, 3, 0)], atol=1e-9)
    np.testing.assert_allclose(box(world, "wall"), [(-4, 2.9, 0), (4, 3.1, 2.5)], atol=1e-9)
    np.testing.assert_allclose(box(world, "terrain"), [(7, -1, 0), (11, 1, 0.5)], atol=1e-6)
    np.testing.assert_allclose(box(world, "post")[:, 2], [0, 1.05], atol=1e-9)
    np.testing.assert_allclose(np.ptp(box(world, "body5"), axis=0), (0.2, 0.4, 0.6), atol=0.01)
    # the corners of the table's board, by mj_forward
    (board,) = [g for g in range(model.ngeom) if model.geom_size[g, 0] == 0.6]
    corners = np.array([*product((-1, 1), repeat=3)]) * model.geom_size[board]
    corners = corners @ data.geom_xmat[board].reshape(3, 3).T + data.geom_xpos[board]
    for corner in corners:
        assert np.linalg.norm(points(world, "table") - corner, axis=1).min() < 1e-9
    # the mesh as it is written, at the pose that is written: MuJoCo moves both
    mug = 0.1 * CORNERS + (0, 0, 0.01)
    expected = pose(world, "mug").apply(mug)
    for corner in expected:
        assert np.linalg.norm(points(world, "mug") - corner, axis=1).min() < 1e-6
    turned = 0.1 * CORNERS @ Rotation.from_euler("z", 90, degrees=True).as_matrix().T + (1, 1, 0)
    for corner in turned:
        assert np.linalg.norm(points(world, "solid") - corner, axis=1).min() < 1e-6
    np.testing.assert_allclose(pose(world, "solid").translation, (1, 1, 0), atol=1e-6)


def test_warnings_become_notes_and_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, SCENE.replace('<light pos="0 0 3"/>', '<light pos="0 0 NaN"/>'))
    (note,) = read_mjcf(path).notes
    assert "NaN" in note
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_the_role_chooses_the_geoms(tmp_path: Path) -> None:
    path = written(tmp_path)
    seen, solid = (read_mjcf(path, geometry=role) for role in ("visual", "collision"))
    assert np.ptp(box(seen, "mug")[:, 0]) < 0.2
    assert np.ptp(box(solid, "mug")[:, 0]) == pytest.approx(0.6, abs=0.02)
    np.testing.assert_allclose(box(seen, "table"), box(solid, "table"))
    path.write_text(SCENE.replace('size="0.3"/>', 'size="0.3" contype="0"/>'))
    assert np.ptp(box(read_mjcf(path), "mug")[:, 0]) < 0.2, "it collides by its affinity"
    path.write_text(SCENE.replace('group="3" ', ""))  # MuJoCo draws what is in one group
    assert np.ptp(box(read_mjcf(path), "mug")[:, 0]) == pytest.approx(0.6, abs=0.02)


RELAXED = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
angles = st.floats(-180, 180)
places = st.tuples(*[st.floats(-3, 3)] * 3)
trees = st.recursive(
    st.tuples(places, st.tuples(angles, angles, angles), st.booleans(), st.just([])),
    lambda inner: st.tuples(
        places, st.tuples(angles, angles, angles), st.booleans(), st.lists(inner, max_size=3)
    ),
    max_leaves=6,
)


@settings(RELAXED, max_examples=30)
@given(trees)
def test_nested_bodies_stand_as_in_mujoco(tmp_path: Path, tree) -> None:
    names = iter(range(1000))

    def body(place, turn, solid, inner) -> str:
        geom = '<geom type="box" size="0.1 0.2 0.3"/>' if solid else ""
        return (
            f'<body name="b{next(names)}" pos="{" ".join(map(str, place))}" '
            f'euler="{" ".join(map(str, turn))}">{geom}{"".join(body(*i) for i in inner)}</body>'
        )

    text = f"<mujoco><worldbody><geom type='sphere' size='1'/>{body(*tree)}</worldbody></mujoco>"
    path = written(tmp_path, text)
    world = read_mjcf(path)
    assert len(same_poses(world, path)) == text.count('type="box"')


def test_a_scene_is_imported_with_its_holders(tmp_path: Path, database: str) -> None:
    with semmap.connect(database) as db:
        summary = db.import_file(written(tmp_path), map="flat")
        flat = db.map("flat")
        assert summary.kinds["object"] == 8
        assert flat["mug"].holder == flat["table"]
        again = db.import_file(tmp_path / "flat.xml", map="flat")
        assert (again.added, again.changed, again.removed) == (0, 0, 0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not well-formed"),
        (SCENE[:700], "not well-formed"),
        ("<robot/>", "not the expected root, <mujoco>"),
        ("<!DOCTYPE a><mujoco/>", "document type"),
        ("<mujoco/>", "no node has a surface"),
        (SCENE.replace("solid.obj", "none.obj"), "cannot compile it .*none.obj"),
        (SCENE.replace('type="box"', 'type="cube"'), "cannot compile it .*cube"),
        (
            "<mujoco><worldbody><replicate count='1000000000'><geom size='1'/></replicate>"
            "</worldbody></mujoco>",
            "parts",
        ),
        (
            "<mujoco><worldbody>" + "<body>" * 99 + "</body>" * 99 + "</worldbody></mujoco>",
            "Nest it less deeply",
        ),
    ],
)
def test_bad_files_are_refused_by_name(text: str, message: str, tmp_path: Path) -> None:
    path = written(tmp_path, text)
    with pytest.raises(WorldError, match=message) as refused:
        read_world(path)
    assert str(path) in str(refused.value)
