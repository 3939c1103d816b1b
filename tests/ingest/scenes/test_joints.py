"""Joints of URDF and MJCF that imports keep; yourdfpy and MuJoCo move the parts."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy

from semmap.geometry.pose import Pose
from semmap.ingest.scenes.mjcf_scene import read_mjcf
from semmap.ingest.scenes.urdf_scene import read_urdf_scene
from semmap.ingest.world import Entry, World

BOX = '<visual><geometry><box size="0.4 0.3 0.2"/></geometry></visual>'
URDF = f"""<robot name="cabinet">
<link name="body">{BOX}</link><link name="pivot"/><link name="door">{BOX}</link>
<link name="knob">{BOX}</link><link name="drawer">{BOX}</link><link name="still">{BOX}</link>
<joint name="turn" type="revolute"><parent link="body"/><child link="pivot"/>
  <origin xyz="0.1 0.2 0.3" rpy="0.4 0 0.5"/><axis xyz="0 0 2"/><limit lower="-0.2" upper="1.5"/></joint>
<joint name="aside" type="fixed"><parent link="pivot"/><child link="door"/><origin xyz="0.3 0 0" rpy="0 0.2 0"/></joint>
<joint name="on" type="fixed"><parent link="door"/><child link="knob"/><origin xyz="0.1 0 0"/></joint>
<joint name="out" type="prismatic"><parent link="body"/><child link="drawer"/><axis xyz="0 1 0"/><limit lower="0" upper="0.3"/></joint>
<joint name="stays" type="fixed"><parent link="body"/><child link="still"/></joint>
</robot>"""  # noqa: E501
MJCF = """<mujoco><worldbody><body name="body"><geom type="box" size="0.2 0.2 0.2"/>
<body name="door" pos="0.3 0.1 0" euler="0 0 30"><joint name="turn" type="hinge" axis="0 0 1" pos="0 0.2 0" range="0 80"/>
<geom type="box" size="0.01 0.2 0.2"/></body>
<body name="drawer" pos="0 0 0.5"><joint name="out" type="slide" axis="1 0 0"/><geom type="box" size="0.1 0.1 0.1"/></body>
</body></worldbody></mujoco>"""  # noqa: E501


def entries(world: World) -> dict[str, Entry]:
    return {entry.name: entry for entry in world.entries}


def moved(entry: Entry, position: float) -> np.ndarray:
    """The pose of a part in the frame of what it is jointed to, at a position of its joint."""
    joint = entry.properties["joint"]
    closed = Pose(*joint["closed"]).matrix
    axis = np.array(joint["axis"]) / np.linalg.norm(joint["axis"])
    if joint["type"] == "prismatic":
        return closed @ trimesh.transformations.translation_matrix(position * axis)
    return closed @ trimesh.transformations.rotation_matrix(position, axis, joint["point"])


def test_joints_of_a_urdf_are_kept_also_through_links_without_geometry(tmp_path: Path) -> None:
    path = tmp_path / "cabinet.urdf"
    path.write_text(URDF)
    world = read_urdf_scene(path)
    found = entries(world)
    links = {(link.subject, link.relation, link.object) for link in world.links}
    assert links == {("door", "jointed_to", "body"), ("drawer", "jointed_to", "body")}
    assert found["door"].properties["joint"]["lower"] == -0.2
    assert found["drawer"].properties["joint"]["upper"] == 0.3
    assert found["knob"].properties["joint"] == {"type": "fixed"}
    assert "joint" not in found["still"].properties
    robot = yourdfpy.URDF.load(str(path), load_meshes=False)
    for turn, out in ((0.0, 0.0), (1.1, 0.2), (-0.2, 0.3)):
        robot.update_cfg({"turn": turn, "out": out})
        for name, position in (("door", turn), ("drawer", out)):
            there = robot.get_transform(name, "body")
            assert np.allclose(moved(found[name], position), there, atol=1e-9)


def test_joints_of_mjcf_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "cabinet.xml"
    path.write_text(MJCF)
    found = entries(read_mjcf(path))
    assert found["door"].properties["joint"]["upper"] == pytest.approx(np.radians(80))
    assert found["drawer"].properties["joint"]["upper"] is None
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.9, 0.25
    mujoco.mj_kinematics(model, data)
    for name, position in (("door", 0.9), ("drawer", 0.25)):
        there = np.eye(4)
        there[:3, :3] = data.body(name).xmat.reshape(3, 3)
        there[:3, 3] = data.body(name).xpos
        assert np.allclose(moved(found[name], position), there, atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('axis xyz="0 1 0"', 'axis xyz="0 1"', "axis"),
        ('upper="0.3"', 'upper="wide"', "upper is 'wide'"),
        ('upper="0.3"', 'upper="-1"', "its limits are 0 and -1"),
    ],
)
def test_a_joint_that_cannot_be_used_is_left_out(
    tmp_path: Path, old: str, new: str, problem: str
) -> None:
    path = tmp_path / "cabinet.urdf"
    path.write_text(URDF.replace(old, new))
    world = read_urdf_scene(path)
    assert "joint" not in entries(world)["drawer"].properties
    (skipped,) = world.skipped
    assert problem in f"{skipped.element}: {skipped.problem}"
