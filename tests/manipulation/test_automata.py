"""Robots with arms: what a Panda beside the table reaches, and the motions that it keeps."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import yourdfpy
from sqlalchemy import text

from planner.mission.behaviours import Outcome
from planner.mission.command import Command
from planner.mission.store.grasp_memory import GraspMemory
from semmap.geometry.pose import Pose
from semmap.manipulation.arm_motions import plan_action
from semmap.manipulation.automata import (
    automaton_of,
    base_pose,
    quickest_first,
    reachable_rows,
    register_robot,
    stored_arm,
)
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.places import find_places
from semmap.manipulation.retrieval import find_grasps, register_gripper
from semmap.manipulation.store.tasks import record_task
from tests.command_line import semmap
from tests.manipulation.cup_map import path_between
from tests.manipulation.grippers import gripper_by_hand, urdf
from tests.seen import seen_by

BASE = Pose.planar(0.85, 1.0, 0.6, 0.7)
"""Beside the table, from which cup1 is 53 cm away."""

READY = dict(
    zip((f"panda_joint{i}" for i in range(1, 8)), (0, -0.8, 0, -2.2, 0, 1.6, 0.8), strict=True)
)


@pytest.fixture
def panda(cups):
    """The map's session, in which a Panda is stored."""
    here = cups.connection
    assert register_robot(here, urdf("panda"), "panda") == "panda"
    return here


def reached(here, base=BASE, limit=6):
    rows = find_grasps(seen_by(here), name="cup1", gripper="panda_gripper", limit=200).rows
    return rows, reachable_rows(rows, stored_arm(here, "panda")[1], base, limit)


def test_what_is_reached_is_where_forward_kinematics_lead(panda):
    gripper, arm = stored_arm(panda, "panda")
    assert gripper == "panda_gripper"
    rows, near = reached(panda)
    assert len(near) == 6
    known = {row["action_id"] for row in rows}
    for row in near:
        assert row["action_id"] in known
        position = np.array([row["position"][joint.name] for joint in arm.joints])
        assert ((position >= arm.low) & (position <= arm.high)).all()
        reach = BASE.matrix @ arm.grasp_pose(position)
        np.testing.assert_allclose(reach, row["pre_pose"].matrix, atol=1e-2)
    assert reached(panda, Pose.planar(3.5, 1.0, 0.0))[1] == []


def test_a_path_is_followed_again_until_something_moves_into_its_way(cups, panda):
    _, arm = stored_arm(panda, "panda")
    _, rows = reached(panda)
    first = plan_action(seen_by(panda), "panda", BASE, rows, state=READY, seconds=20)
    assert first is not None
    assert not first.reused
    again = plan_action(seen_by(panda), "panda", BASE, rows, state=READY, seconds=20)
    assert again is not None
    assert again.reused
    assert again.path == first.path
    np.testing.assert_allclose(again.to_pre_grasp, first.to_pre_grasp)
    start = [READY[name] for name in first.joints]
    np.testing.assert_allclose(first.to_pre_grasp[0], start)
    np.testing.assert_allclose(first.back[-1], start)
    there = BASE.matrix @ arm.grasp_pose(first.approach[-1])
    np.testing.assert_allclose(there, first.row["pose"].matrix, atol=1e-2)
    inverse = np.linalg.inv(arm.gripper.frame)
    ends = [BASE.matrix @ arm.grasp_pose(first.to_pre_grasp[i]) @ inverse for i in (0, -1)]
    way = path_between(panda, "panda", *ends, link=arm.gripper.palm)
    assert way is not None
    assert len(way) == len(first.to_pre_grasp)
    middle = way[len(way) // 2]
    cups.add_object("parcel", type="box", size=(0.05, 0.05, 0.05), pose=middle[:3])
    assert path_between(panda, "panda", *ends, link=arm.gripper.palm) is None


def test_where_a_robot_stands(cups, panda):
    assert base_pose(seen_by(panda), "robot")[:3] == pytest.approx((3.4, 2, 0))
    assert base_pose(seen_by(panda), "panda", (1, 1, 0.5)) == pytest.approx(Pose.planar(1, 1, 0.5))
    assert base_pose(seen_by(panda), "panda", (1, 1, 0, 0.4)).z == 0.4
    with pytest.raises(LookupError, match="no agent panda with a pose: give its base"):
        base_pose(seen_by(panda), "panda")
    with pytest.raises(ManipulationError, match="a base is x, y, yaw"):
        base_pose(seen_by(panda), "panda", (1, float("nan"), 0))


def test_unknown_robots_and_those_without_an_arm(panda, tmp_path):
    with pytest.raises(LookupError, match="no robot pandu with a gripper; did you mean panda"):
        stored_arm(panda, "pandu")
    gripper_by_hand(tmp_path)
    with pytest.raises(ManipulationError, match="no joint moves palm"):
        register_robot(panda, tmp_path / "two_plates.urdf", "plates")
    assert automaton_of(panda, "plates", None, "panda") == ("panda", "panda_gripper")


def test_a_gripper_of_its_name_leaves_a_robot_its_arm(cups):
    """A gripper that is read from the URDF of a whole robot has the robot's name."""
    here = cups.connection
    assert register_gripper(here, urdf("panda")) == "panda"
    register_robot(here, urdf("panda"), "panda")
    assert automaton_of(here, "panda") == ("panda", "panda_gripper")
    assert len(stored_arm(here, "panda")[1].joints) == 7


def test_the_quickest_comes_first_after_what_succeeded(panda):
    """Seconds of the joint that takes longest, by the velocities that yourdfpy reads."""
    arm, random = stored_arm(panda, "panda")[1], np.random.default_rng(3)
    joints = yourdfpy.URDF.load(
        str(urdf("panda")), load_meshes=False, filename_handler=lambda file: file
    ).joint_map
    rows = []
    for number, position in enumerate(random.uniform(arm.low, arm.high, (30, len(arm.low)))):
        named = dict(zip((joint.name for joint in arm.joints), position.tolist(), strict=True))
        tried = {"attempts": number % 3, "successes": int(number % 7 == 1)}
        rows.append({"position": named, "expected": random.uniform(0.1, 1), **tried})
    names, rest = [*rows[0]["position"]], dict(zip([*rows[0]["position"]], arm.rest(), strict=True))

    def cost(row):
        moved = [abs(row["position"][name] - rest[name]) for name in names]
        speeds = [min(1.0, joints[name].limit.velocity) for name in names]
        return max(np.divide(moved, speeds)) / row["expected"]

    def worked(row):
        return row["successes"] > 0 and row["successes"] >= row["attempts"] / 2

    first = sorted(filter(worked, rows), key=cost)
    others = sorted((row for row in rows if not worked(row)), key=cost)
    assert first
    assert quickest_first(rows, arm) == first + others


def test_a_mission_takes_what_the_arm_of_its_robot_reaches(cup_map):
    """The robot of the map is of the class panda; far from the table, no grasp is within reach."""
    pickup = Command("pickup", ("cup1", "table"))
    with cup_map.database.engine.connect() as connection:
        connection.execute(text("SELECT set_config('semmap.map', 'kitchen', true)"))
        session = connection.connection.driver_connection
        register_robot(session, urdf("panda"), "panda")
        connection.execute(
            text("UPDATE entity SET properties = :p WHERE id = entity_id('robot')"),
            {"p": json.dumps({"robot_class": "panda"})},
        )
        robot = connection.execute(text("SELECT entity_id('robot')")).scalar_one()
        memory = GraspMemory()
        refused = memory.begin(seen_by(connection), robot, pickup).refusal
        assert refused.cause == "unable"
        assert "within reach of panda" in refused.message
        connection.execute(
            text("UPDATE placement SET holder_id = NULL, pose = :pose WHERE entity_id = :id"),
            {"pose": BASE.row, "id": robot},
        )
        choice = memory.begin(seen_by(connection), robot, pickup)
        near, arm = reached(session, limit=400)[1], stored_arm(session, "panda")[1]
        seconds = {
            r["action_id"]: arm.seconds(arm.rest(), arm.position(r["position"])) for r in near
        }
        assert seconds[choice.action] <= np.median([*seconds.values()])
        assert choice.note.endswith("of the arm, planned")
        ((path, link, joints),) = connection.execute(text(PATHS)).all()
        assert f"path {path} of" in choice.note
        assert (link, len(joints)) == ("panda_hand", 7)
        again = memory.begin(seen_by(connection), robot, pickup)
        assert again.note.endswith(f"path {path} of the arm, followed again")
        connection.rollback()


PATHS = "SELECT id, link, joints FROM path ORDER BY id"


def test_a_mission_brings_what_it_holds_to_where_the_arm_puts_it_down(cup_map):
    """The cup is a part of the robot; what stands in the way of its arm is the reason."""
    pickup, put = Command("pickup", ("cup1", "table")), Command("place", ("cup1", "table"))
    with cup_map.database.engine.connect() as connection:
        connection.execute(text("SELECT set_config('semmap.map', 'kitchen', true)"))
        session = connection.connection.driver_connection
        register_robot(session, urdf("panda"), "robot")
        robot = connection.execute(text("SELECT entity_id('robot')")).scalar_one()
        moved = "UPDATE placement SET holder_id = :h, pose = :pose WHERE entity_id = entity_id(:n)"
        here = {"h": None, "pose": BASE.row, "n": "robot"}
        connection.execute(text(moved), here)
        memory = GraspMemory()
        stood = connection.execute(
            text("SELECT pose FROM world WHERE entity_id = entity_id('cup1')")
        )
        stood = Pose(*stood.scalar_one())
        assert memory.begin(seen_by(connection), robot, pickup, put).action is not None
        memory.end(connection, robot, pickup, Outcome())
        grip = {"h": robot, "pose": [0.3, 0.0, 0.8, 0.0, 0.0, 1.0, 0.0], "n": "cup1"}
        connection.execute(text(moved), grip)
        (spot,) = memory.spots(seen_by(connection), robot, "cup1", "table", stood)
        choice = memory.begin(seen_by(connection), robot, replace(put, spot=spot))
        assert choice.refusal is None, choice.refusal
        assert choice.note.endswith("of the arm, planned")
        assert len(connection.execute(text(PATHS)).all()) == 2
        memory.end(connection, robot, put, Outcome("missed"))
        short = GraspMemory(motion_seconds=1e-9).begin(
            seen_by(connection), robot, replace(put, spot=spot)
        )
        assert "without a free motion of robot" in short.refusal.message
        off = GraspMemory(motion_seconds=None).begin(
            seen_by(connection), robot, replace(put, spot=spot)
        )
        assert (off.refusal, off.note) == (None, "")
        connection.rollback()


def test_a_mission_puts_down_where_the_arm_of_its_robot_reaches(cup_map):
    """From beside the table, near its end; from the door, nowhere."""
    with cup_map.database.engine.connect() as connection:
        connection.execute(text("SELECT set_config('semmap.map', 'kitchen', true)"))
        session = connection.connection.driver_connection
        register_robot(session, urdf("panda"), "panda")
        move = text("UPDATE placement SET holder_id = NULL, pose = :p WHERE entity_id = :id")
        robot = connection.execute(text("SELECT entity_id('robot')")).scalar_one()
        connection.execute(
            text("UPDATE entity SET properties = :p WHERE id = :id"),
            {"p": json.dumps({"robot_class": "panda"}), "id": robot},
        )
        connection.execute(move, {"p": BASE.row, "id": robot})
        memory, pickup = GraspMemory(), Command("pickup", ("cup1", "table"))
        assert memory.begin(seen_by(connection), robot, pickup).action is not None
        memory.end(connection, robot, pickup, Outcome())
        (spot,) = memory.spots(seen_by(connection), robot, "cup1", "table", BASE)
        free = find_places(
            seen_by(session), "cup1", "table", gripper="panda_gripper", towards=(2.2, 1.5)
        )
        other = free.rows[0]["spot"]
        assert np.hypot(spot.x - BASE.x, spot.y - BASE.y) < 0.85 < np.hypot(other.x - BASE.x, 0)
        connection.execute(move, {"p": Pose.planar(3.6, 0.3, 0, 0.7).row, "id": robot})
        assert (
            memory.spots(seen_by(connection), robot, "cup1", "table", Pose.planar(2.2, 1.5, 0))
            == []
        )
        connection.rollback()


def test_a_held_object_is_put_down_by_the_grasp_that_holds_it(panda):
    """Without a stated grasp, places end the one with which an agent of the map took the object."""
    _, rows = reached(panda)
    grasp = rows[3]["action_id"]
    record_task(panda, "cup1", action=grasp, outcome="completed", robot="robot")
    panda.execute(
        "UPDATE placement SET holder_id = entity_id('robot'), relation = 'in', "
        "pose = '{0.4,0,0.8,0,0,0,1}' WHERE entity_id = entity_id('cup1')"
    )
    arm = stored_arm(panda, "panda")[1]
    found = find_places(
        seen_by(panda), "cup1", "table", gripper="panda_gripper", arm=arm, base=BASE
    )
    assert {row["grasp_id"] for row in found.rows} == {grasp}
    motion = plan_action(seen_by(panda), "panda", BASE, found.rows, state=READY, seconds=20)
    assert motion is not None
    put = BASE.matrix @ arm.grasp_pose(motion.approach[-1])
    in_hand = np.linalg.inv(motion.row["model_pose"].matrix)
    np.testing.assert_allclose(put @ in_hand, motion.row["spot"].matrix, atol=1e-2)
    with pytest.raises(ManipulationError, match="its arm has no joint elbow"):
        plan_action(seen_by(panda), "panda", BASE, found.rows, state={"elbow": 1})


def test_the_commands_of_a_robot(cup_map):
    url = cup_map.database.engine.url.render_as_string(hide_password=False)
    assert semmap(url, "manipulation", "add-robot", urdf("panda")).stdout.strip() == "panda"
    words = ("grasp", "cup1", "--map", "kitchen", "--robot", "panda")
    told = semmap(url, *words, "--base", "0.85,1.0,0.6,0.7", "--json", "--limit", 2)
    assert {row["entity"] for row in json.loads(told.stdout)} == {"cup1"}
    motion = ("--plan", "--state", json.dumps(READY), "--json")
    (row,) = json.loads(semmap(url, *words, "--base", "0.85,1.0,0.6,0.7", *motion).stdout)
    assert np.shape(row["to_pre_grasp"])[1] == len(row["joints"]) == 7
    far = semmap(url, *words, "--base", "3.5,1,0")
    assert (far.exit_code, far.stdout) == (1, "")
    with pytest.raises(ValueError, match="plan: only for a robot"):
        semmap(url, "grasp", "cup1", "--plan")
    with pytest.raises(ValueError, match="--state takes JSON"):
        semmap(url, *words, "--base", "0.85,1.0,0.6", "--state", "[1]", "--plan")
