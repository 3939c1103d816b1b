"""A TIAGo at the kitchen table of the small house: how it takes, puts down, pushes and fetches.

The motions are followed with the kinematics of yourdfpy, and what the hand holds is checked against
the table by linear programs.
"""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yourdfpy
from sqlalchemy import Engine

import semmap as package
from semmap.geometry.pose import Pose
from semmap.manipulation.arm import Arm
from semmap.manipulation.arm_motions import WAYS
from semmap.manipulation.store.model_shapes import model_mesh
from tests.command_line import semmap
from tests.manipulation.grippers import real_gripper, urdf
from tests.manipulation.test_motion import touches
from tests.seen import seen_by

TABLE = "KitchenTable_01_001"
BASE, FAR = "5.1,0.95,0", "2,0.95,0"
TOP = np.array((5.7, 0.65, 0.77)), np.array((7.41, 1.25, 0.799))
"""The table's top within its round edge."""

FOLDED = json.dumps(
    {
        "arm_1_joint": 0.2,
        "arm_2_joint": -1.34,
        "arm_3_joint": -0.2,
        "arm_4_joint": 1.94,
        "arm_5_joint": -1.57,
        "arm_6_joint": 1.37,
    }
)


class Kitchen(NamedTuple):
    url: str
    corners: dict[str, Any]
    """(N, 3) of the meshes of objects, in their models' frames."""


THINGS = {
    "can": ("005_tomato_soup_can", (5.86, 0.87, 0.80135)),
    "bottle": ("006_mustard_bottle", (5.86, 1.07, 0.80135)),
}
"""What is on the table: meshes, and where their frames are."""


@pytest.fixture(scope="module")
def kitchen(house: Engine, worlds: Path) -> Kitchen:
    """The small house with a can and a bottle on its kitchen table; the database knows a TIAGo."""
    url = house.url.render_as_string(hide_password=False)
    corners = {}
    with package.connect(url) as db:
        here = db.map("house")
        for name, (mesh, pose) in THINGS.items():
            path = worlds / "ycb" / "meshes" / f"{mesh}_textured.gltf"
            here.add_object(name, type=name, mesh=path, pose=pose)
            corners[name] = np.asarray(model_mesh(seen_by(here.connection), name).vertices)
    told = semmap(url, "manipulation", "add-robot", urdf("tiago"), "--name", "tiago")
    assert told.exit_code == 0, told.output
    told = semmap(url, "robot", "add", "tiago", "--robot", urdf("tiago"), "--state", FOLDED)
    assert told.exit_code == 0, told.output
    return Kitchen(url, corners)


@pytest.fixture(scope="module")
def palms() -> Any:
    """The pose of the grasp frame in the map at positions of the joints, by yourdfpy."""
    robot = yourdfpy.URDF.load(
        str(urdf("tiago")), load_meshes=False, filename_handler=lambda file: file
    )
    arm = Arm(real_gripper("tiago"))
    root = arm.robot.link_poses({}, [robot.base_link])[robot.base_link]
    there = Pose.planar(5.1, 0.95, 0.0).matrix

    def pose(joints: list[str], position: list[float], base: Any = there) -> Any:
        robot.update_cfg(dict(zip(joints, position, strict=True)))
        return base @ root @ robot.get_transform(arm.gripper.palm) @ arm.gripper.frame

    return pose


def rows(kitchen: Kitchen, *words: object) -> list[dict[str, Any]]:
    told = semmap(kitchen.url, *words, "--map", "house", "--json")
    assert told.exit_code == 0, told.output
    found: list[dict[str, Any]] = json.loads(told.stdout)
    return found


def near(pose: Any, other: list[float]) -> None:
    np.testing.assert_allclose(pose[:3, 3], other[:3], atol=3e-3)
    np.testing.assert_allclose(pose[:3, :3], Pose(*other).rotation_matrix, atol=0.02)


def test_a_can_is_carried_to_where_the_arm_puts_it_down(kitchen: Kitchen, palms: Any) -> None:
    words = ("place", "can", "--on", TABLE, "--robot", "tiago")
    reached = rows(kitchen, *words, "--base", BASE, "--limit", 5)
    assert len(reached) == 5
    assert max(row["spot"][0] for row in reached) < 6.3  # the table is 1.8 m long
    (row,) = rows(kitchen, *words, "--base", BASE, "--plan")
    joints = row["joints"]
    in_hand = np.linalg.inv(Pose(*row["model_pose"]).matrix)
    carried = [*row["to_pre_place"], *row["approach_positions"]]
    for position in carried[::4] + carried[-1:]:
        item = palms(joints, position) @ in_hand
        assert not touches(kitchen.corners["can"] @ item[:3, :3].T + item[:3, 3], *TOP)
    near(palms(joints, row["to_pre_place"][-1]), row["pre_pose"])
    near(palms(joints, carried[-1]) @ in_hand, row["spot"])
    near(palms(joints, row["retreat_positions"][-1]), row["post_pose"])
    lowest = (kitchen.corners["can"] @ Pose(*row["spot"]).rotation_matrix.T)[:, 2].min() + row[
        "spot"
    ][2]
    assert 0.801 < lowest < 0.806
    (again,) = rows(kitchen, *words, "--base", BASE, "--plan")
    assert again["path"] == row["path"]


def test_a_bottle_is_taken_and_carried_near_the_robot(kitchen: Kitchen, palms: Any) -> None:
    words = ("grasp", "bottle", "--robot", "tiago", "--base", BASE, "--limit", 100, "--plan")
    (row,) = rows(kitchen, *words)
    joints, x, y = row["joints"], *map(float, BASE.split(",")[:2])
    near(palms(joints, row["approach_positions"][-1]), row["pose"])
    in_hand = np.linalg.inv(Pose(*row["pose"]).matrix) @ Pose(*THINGS["bottle"][1]).matrix
    poses = [palms(joints, position) @ in_hand for position in row["back_positions"]]
    for item in [*poses[12::3], poses[-1]]:  # lifted before
        corners = kitchen.corners["bottle"] @ item[:3, :3].T + item[:3, 3]
        assert not touches(corners, *TOP)
    assert all(pose[2, 3] > poses[0][2, 3] - 1e-3 for pose in poses[:11])
    corners = kitchen.corners["bottle"] @ poses[-1][:3, :3].T + poses[-1][:3, 3]
    assert np.hypot(corners[:, 0] - x, corners[:, 1] - y).max() < 0.6
    assert np.hypot(*(palms(joints, [0.0] * len(joints))[:2, 3] - (x, y))) > 0.8  # at rest
    np.testing.assert_allclose(row["back_positions"][-1], row["to_pre_grasp"][0])


def test_it_brings_a_bottle_to_another_table(kitchen: Kitchen, palms: Any) -> None:
    """The mission of the paper, from end to end: tried in simulation, and planned for the arm.

    What the robot is told moves its arm, by yourdfpy, from how it is carried to the bottle, to the
    spot on the table, and back, without a jump.
    """
    goal = "on(bottle, CoffeeTable_01_001)"
    with package.connect(kitchen.url) as db:
        ran = db.map("house").run(goal, robot="tiago", start="kitchen", speed=1000)
        assert ran.done, ran.reason
        there = db.map(ran.map)
        ((posture,),) = there.execute("SELECT posture FROM automaton WHERE name = 'tiago'")
        told = "SELECT command FROM mission_step WHERE mission_id = %s ORDER BY number"
        commands = [command for (command,) in there.execute(told, ran.mission)]
        for action, name in (("grasp", "pickup"), ("place", "place")):
            (step,) = (each for each in ran.steps if each["action"] == name)
            assert "tried in simulation; path " in step["message"]
            assert "of the arm, planned" in step["message"]
            (command,) = (each for each in commands if each["behaviour"] == name)
            kind = "SELECT kind FROM action WHERE id = %s"
            assert there.execute(kind, command["action"]) == [(action,)]
            motion = command["motion"]
            ways = [np.array(motion[way]) for way in WAYS if motion[way]]
            assert len(ways) == (3 if name == "pickup" else 4)
            rest = [posture[joint] for joint in motion["joints"]]
            np.testing.assert_allclose(ways[0][0], rest, atol=1e-3)
            np.testing.assert_allclose(ways[-1][-1], rest, atol=1e-3)
            for one, other in pairwise(ways):
                np.testing.assert_allclose(one[-1], other[0], atol=1e-3)
            assert np.abs(np.diff(np.concatenate(ways), axis=0)).max() < 0.51
            at = palms(motion["joints"], ways[1][-1], Pose.of_json(command["at"]).matrix)
            near(at, motion["pose"])


def test_a_can_is_pushed_by_the_arm_away_from_the_robot(kitchen: Kitchen, palms: Any) -> None:
    words = ("push", "can", "--robot", "tiago", "--base", BASE)
    (row,) = rows(kitchen, *words, "--plan")
    every = rows(kitchen, "push", "can", "--gripper", "tiago_gripper", "--limit", 16)
    directions = {each["direction"] for each in every}
    assert {each["direction"] for each in rows(kitchen, *words)} < directions
    for keys in (("to_pre_push", "pre_pose"), ("approach_positions", "pose")):
        near(palms(row["joints"], row[keys[0]][-1]), row[keys[1]])
    tips = [palms(row["joints"], position)[:3, 3] for position in row["push_positions"]]
    way = tips[-1] - tips[0]
    assert np.hypot(*way[:2]) == pytest.approx(0.1, abs=3e-3)
    assert way[0] > 0
    line = np.array(tips) - tips[0]
    off = line - np.outer(line @ way, way) / (way @ way)
    assert np.abs(off).max() < 3e-3


def test_from_afar_nothing_is_reached(kitchen: Kitchen) -> None:
    words = ("--robot", "tiago", "--base", FAR, "--map", "house")
    told = semmap(kitchen.url, "place", "can", "--on", TABLE, *words)
    assert (told.exit_code, told.stdout) == (1, "")
    assert "all of it is beyond the arm at (2, 0.95)" in told.stderr
    told = semmap(kitchen.url, "push", "can", *words)
    assert (told.exit_code, told.stdout) == (1, "")
    assert "the arm at (2, 0.95) reaches none of" in told.stderr
    both = ("--gripper", "tiago_gripper", "--map", "house")
    with pytest.raises(ValueError, match="tiago has its own gripper"):
        semmap(kitchen.url, "push", "can", "--robot", "tiago", *both)
    with pytest.raises(ValueError, match="plan: only for a robot"):
        semmap(kitchen.url, "place", "can", "--on", TABLE, "--plan", *both)
