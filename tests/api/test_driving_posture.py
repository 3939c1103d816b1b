"""Without a posture a robot drives folded, and it is said which posture that is."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import trimesh

import semmap
from semmap.api.driving_posture import driving_posture
from semmap.robot import load_robot, robot_parts
from tests.command_line import semmap as run
from tests.robot.robots import by_hand, real_robot


def overlap(urdf: Path, joints: dict[str, float], part: str, others: set[str]) -> bool:
    """Whether hulls of a part's links meet those of other parts, by trimesh: corners inside."""
    robot = load_robot(urdf)
    links = {p.name: p.links for p in robot_parts(robot, joints)}
    hulls = {
        link: trimesh.convex.convex_hull(corners) for link, corners in robot.hulls(joints).items()
    }
    beside = {j.child for j in robot.joints if j.parent in {k for o in others for k in links[o]}}
    for link in links[part]:
        if link not in hulls or link in beside:
            continue
        for other in (k for o in others for k in links[o] if k in hulls):
            inside = hulls[other].contains(hulls[link].vertices)
            if (
                inside.any()
                and -trimesh.proximity.signed_distance(
                    hulls[other], hulls[link].vertices[inside]
                ).min()
                < -0.01
            ):
                return True
    return False


def test_tiago_drives_with_its_arm_near_its_axis() -> None:
    urdf = real_robot("tiago")
    chosen = driving_posture(None, urdf)
    assert "found" in chosen.source
    assert "arm reaches 1.0" in str(chosen)
    widths = {}
    for joints in ({}, dict(chosen.joints)):
        arm = {p.name: p for p in robot_parts(load_robot(urdf), joints)}["arm"]
        corners = np.concatenate(
            [load_robot(urdf).hulls(joints)[k] for k in arm.links if k in load_robot(urdf).meshes]
        )
        widths[bool(joints)] = float(np.hypot(corners[:, 0], corners[:, 1]).max())
    assert widths[False] > 1.0
    assert widths[True] < 0.45
    assert not overlap(urdf, dict(chosen.joints), "arm", {"base", "torso"})


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
