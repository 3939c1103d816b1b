"""Without a posture a robot drives folded, and it is said which posture that is."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import yourdfpy
from scipy.spatial import ConvexHull

import semmap
from semmap.api.driving_posture import driving_posture
from semmap.manipulation.automata import folded_arm
from semmap.manipulation.gripper_reader import read_gripper
from semmap.robot import Robot, load_robot, robot_parts
from tests.command_line import semmap as run
from tests.robot.robots import by_hand, real_robot


def overlaps(robot: Robot, joints: dict[str, float]) -> set[tuple[str, str]]:
    """Links of the arm with a corner over 1 cm inside the hull of one of base or torso: Qhull's."""
    links = {p.name: p.links for p in robot_parts(robot, joints)}
    corners = robot.hulls(joints)
    found = set()
    for other in (k for k in links["base"] + links["torso"] if k in corners):
        sides = ConvexHull(corners[other]).equations
        for link in (k for k in links["arm"] if k in corners):
            outside = (corners[link] @ sides[:, :3].T + sides[:, 3]).max(axis=1)
            if outside.min() < -0.01:
                found.add((link, other))
    return found


def test_tiago_drives_with_its_arm_near_its_axis() -> None:
    urdf = real_robot("tiago")
    robot = load_robot(urdf)
    chosen = driving_posture(None, urdf)
    assert "found" in chosen.source
    assert "arm reaches 1.0" in str(chosen)
    widths = []
    for joints in ({}, dict(chosen.joints)):
        arm = next(p for p in robot_parts(robot, joints) if p.name == "arm")
        hulls = robot.hulls(joints)
        corners = np.concatenate([hulls[k] for k in arm.links if k in robot.meshes])
        widths.append(float(np.hypot(corners[:, 0], corners[:, 1]).max()))
    assert widths[0] > 1.0
    assert widths[1] < 0.45
    shoulder = overlaps(robot, {})  # what lies within each other as it was built
    assert overlaps(robot, dict(chosen.joints)) <= shoulder
    assert overlaps(robot, {"arm_2_joint": -1.5, "arm_4_joint": 2.3}) > shoulder


def test_both_arms_of_a_robot_are_folded_and_it_drives_and_takes(database: str) -> None:
    """By yourdfpy and Qhull: every joint of both arms is near the axis; they meet no new link."""
    urdf = real_robot("pr2")
    chosen = driving_posture(None, urdf)
    assert "found, as at 0 the left_arm reaches 0.99 m around the robot" in chosen.source
    model = yourdfpy.URDF.load(str(urdf), load_meshes=False, filename_handler=lambda file: file)
    model.update_cfg(dict(chosen.joints))
    base = np.linalg.inv(model.get_transform("base_footprint"))
    for side in "lr":
        links = [f"{side}_{part}_link" for part in ("elbow_flex", "wrist_roll", "gripper_palm")]
        for link in links:
            x, y, z = (base @ model.get_transform(link))[:3, 3]
            assert np.hypot(x, y) < 0.5
            assert z > 0.4
    robot = load_robot(urdf)
    assert _meetings(robot, dict(chosen.joints)) <= _meetings(robot, {})
    both = {"l_shoulder_pan_joint": -0.6, "r_shoulder_pan_joint": 0.6}
    assert _meetings(robot, both) > _meetings(robot, {})
    with semmap.connect(database) as db:
        here = db.create_map("hall")
        for name, x in (("k", 0.0), ("l", 8.1)):
            here.add_room(name, [(x, 0), (x + 8, 0), (x + 8, 6), (x, 6)], ceiling=3)
        here.add_door("d", "k", "l", ((8.05, 2.4), (8.05, 3.6)))
        for name, x in (("Tisch", 3.0), ("mesa", 12.0)):
            here.add_object(name, type="table", size=(1, 0.6, 0.75), pose=(x, 3, 0))
        here.add_object("cup", type="cup", size=(0.05, 0.05, 0.1), pose=(3, 2.8, 0.75))
        db.add_robot("pr2", urdf)
        plan = here.plan("on(cup, mesa)", start="k", robot="pr2")
        assert [step.name for step in plan.actions] == ["pickup", "pass_door", "place"]
        added = db.add_manipulator(urdf, "pr2")
        ((stored,),) = here.execute("SELECT posture FROM automaton WHERE name = %s", added)
    assert stored == dict(chosen.joints)
    assert folded_arm(read_gripper(urdf)).state == stored, "as plans judge what is not stored"


def _meetings(robot: Robot, joints: dict[str, float]) -> set[tuple[str, str]]:
    """Links of an arm with a corner over 1 cm inside the hull of a link of the other one."""
    links = {p.name: p.links for p in robot_parts(robot, joints)}
    corners = robot.hulls(joints)
    found = set()
    for one, two in (("left_arm", "right_arm"), ("right_arm", "left_arm")):
        for other in (k for k in links[two] if k in corners):
            sides = ConvexHull(corners[other]).equations
            for link in (k for k in links[one] if k in corners):
                outside = (corners[link] @ sides[:, :3].T + sides[:, 3]).max(axis=1)
                if outside.min() < -0.01:
                    found.add((link, other))
    return found


def test_a_robot_that_reaches_nowhere_stays_at_rest(tmp_path: Path) -> None:
    assert driving_posture(None, real_robot("stretch")) == ({}, "all joints at 0")
    unfolded = driving_posture(None, by_hand(tmp_path))
    assert unfolded.joints == {}
    assert "though the arm reaches" in unfolded.source, "it has no gripper: it is said"


def test_the_posture_is_stored_with_the_robot_or_given(database: str, tmp_path: Path) -> None:
    urdf = real_robot("tiago")
    added = run(database, "robot", "add", "porter", "--robot", urdf)
    assert "posture: found" in " ".join(added.stdout.split())
    with semmap.connect(database) as db:
        found = driving_posture(db.session, urdf)
        db.add_manipulator(urdf, posture={"arm_1_joint": 0.2, "arm_2_joint": -1.0})
        stored = driving_posture(db.session, urdf)
        given = driving_posture(db.session, urdf, '{"arm_1_joint": 0.3}')
        parts = db.robots["porter"].parts if hasattr(db, "robots") else None
    assert "found" in found.source
    assert stored.joints == {"arm_1_joint": 0.2, "arm_2_joint": -1.0}
    assert stored.source == "stored with the robot tiago"
    assert given == ({"arm_1_joint": 0.3}, "as given")
    if parts is not None:
        assert max(p.circumscribed_radius for p in parts) < 0.45
    world = tmp_path / "yard.world"
    world.write_text(
        '<sdf version="1.7"><world name="yard"><model name="crate"><static>true</static>'
        '<pose>3 3 0.5 0 0 0</pose><link name="l"><visual name="v"><geometry><box>'
        "<size>1 1 1</size></box></geometry></visual></link></model></world></sdf>"
    )
    assert run(database, "import", world, "--map", "yard").exit_code == 0
    words = ("costmap", "--robot", urdf, "--no-picture", "--json", "--resolution", "0.1")
    (files,) = json.loads(run(database, *words, "-o", tmp_path / "out", "--map", "yard").stdout)
    assert files["posture"].startswith("posture: stored with the robot tiago: arm_1_joint 0.2")
