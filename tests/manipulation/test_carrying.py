"""The posture in which an arm is carried: near the robot, by the kinematics of yourdfpy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
import yourdfpy

from semmap.manipulation.arm import Arm
from semmap.manipulation.automata import register_robot, stored_arm
from semmap.manipulation.carrying import carrying_posture
from semmap.manipulation.error import ManipulationError
from tests.command_line import semmap
from tests.manipulation.grippers import real_gripper, urdf

READY = {"panda_joint4": -2.2, "panda_joint6": 1.6}


@pytest.mark.parametrize(("name", "most"), [("tiago", 0.45), ("pr2", 0.55), ("panda", 0.35)])
def test_the_arm_stays_near_the_robot_and_above_the_floor(name: str, most: float) -> None:
    arm = Arm(real_gripper(name))
    posture = carrying_posture(arm)
    robot = yourdfpy.URDF.load(
        str(urdf(name)), load_meshes=False, filename_handler=lambda file: file
    )
    robot.update_cfg(posture)
    root = arm.robot.link_poses({}, [robot.base_link])[robot.base_link]
    at = [root @ robot.get_transform(joint.child) for joint in arm.joints]
    at.append(root @ robot.get_transform(arm.gripper.palm) @ arm.gripper.frame)
    origins = np.array(at)[:, :3, 3]
    assert np.hypot(origins[:, 0], origins[:, 1]).max() < most
    assert origins[:, 2].min() > 0
    position = np.array(list(posture.values()))
    assert ((position >= arm.low - 1e-4) & (position <= arm.high + 1e-4)).all()


@pytest.mark.parametrize("name", ["tiago", "pr2", "tiago_pro"])
def test_what_is_carried_has_room(name: str) -> None:
    """No link but those of the hand is within 9 cm of where it holds, by trimesh."""
    arm = Arm(real_gripper(name))
    robot = yourdfpy.URDF.load(
        str(urdf(name)), load_meshes=False, filename_handler=lambda file: file
    )
    robot.update_cfg(carrying_posture(arm))
    palm = robot.get_transform(arm.gripper.palm)
    held = (palm @ arm.gripper.frame)[:3, 3]
    own = {*arm.gripper.links, *arm.gripper.margins}
    others = [link for link in arm.robot.meshes if link not in own]
    assert others
    for link in others:
        pose = robot.get_transform(link)
        hull = trimesh.convex.convex_hull(trimesh.transform_points(arm.robot.hull(link), pose))
        assert not hull.contains([held])[0]
        assert trimesh.proximity.closest_point(hull, [held])[1][0] > 0.09, link


def test_the_same_robot_is_carried_in_the_same_way() -> None:
    postures = [carrying_posture(Arm(real_gripper("tiago"))) for _ in range(2)]
    assert postures[0] == postures[1]


def test_a_given_posture_is_stored_and_taken_back(cups) -> None:
    here = cups.connection
    register_robot(here, urdf("panda"), "panda", posture=READY)
    _, arm = stored_arm(here, "panda")
    rest = dict(zip((j.name for j in arm.joints), arm.rest(), strict=True))
    assert {name: rest[name] for name in READY} == READY
    register_robot(here, urdf("panda"), "panda")
    _, arm = stored_arm(here, "panda")
    found = carrying_posture(Arm(real_gripper("panda")))
    np.testing.assert_allclose(arm.rest(), list(found.values()))


@pytest.mark.parametrize(
    ("posture", "reason"),
    [
        ({"panda_joint9": 0.0}, "panda has no joint panda_joint9; did you mean panda_joint"),
        ({"panda_joint4": 1.0}, "joint panda_joint4 at 1.0 is beyond its limits -3.07"),
    ],
)
def test_a_wrong_posture_is_refused_and_stores_nothing(cups, posture, reason) -> None:
    here = cups.connection
    with pytest.raises(ManipulationError, match=reason):
        register_robot(here, urdf("panda"), "wrong", posture=posture)
    assert here.execute("SELECT count(*) FROM device WHERE name = 'wrong'").fetchone() == (0,)


def test_the_state_of_a_command_is_json_or_a_file(cup_map, tmp_path: Path) -> None:
    url = cup_map.database.engine.url.render_as_string(hide_password=False)
    words = ("manipulation", "add-robot", urdf("panda"), "--state")
    (tmp_path / "ready.json").write_text('{"panda_joint4": -2.2}')
    assert semmap(url, *words, tmp_path / "ready.json").exit_code == 0
    told = semmap(url, "sql", "SELECT posture FROM automaton")
    assert '"panda_joint4": -2.2' in told.stdout
    with pytest.raises(ValueError, match="is neither JSON nor a file"):
        semmap(url, *words, "nowhere")
