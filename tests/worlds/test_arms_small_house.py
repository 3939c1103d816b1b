"""A TIAGo at the kitchen table of the small house: where it puts a can down, and how it pushes it.

The motions are followed with the kinematics of yourdfpy, and what the hand holds is checked against
the table by linear programs.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yourdfpy
from sqlalchemy import Engine

import semmap as package
from semmap.geometry.pose import Pose
from semmap.manipulation.arm import Arm
from semmap.manipulation.shape_store import model_mesh
from tests.command_line import semmap
from tests.manipulation.grippers import real_gripper, urdf
from tests.manipulation.test_motion import touches

TABLE = "KitchenTable_01_001"
BASE, FAR = "5.1,0.95,0", "2,0.95,0"
TOP = np.array((5.7, 0.65, 0.77)), np.array((7.41, 1.25, 0.799))
"""The table's top within its round edge."""


class Kitchen(NamedTuple):
    url: str
    corners: Any
    """(N, 3) of the can, in its model's frame."""


@pytest.fixture(scope="module")
def kitchen(bare_house: Engine, worlds: Path) -> Kitchen:
    """The small house with a can on its kitchen table; the database knows a TIAGo."""
    url = bare_house.url.render_as_string(hide_password=False)
    can = worlds / "ycb" / "meshes" / "005_tomato_soup_can_textured.gltf"
    with package.connect(url) as db:
        house = db.map("house")
        house.add_object("can", type="can", mesh=can, pose=(5.86, 0.87, 0.80135))
        corners = np.asarray(model_mesh(house.session_of_map(), "can").vertices)
    told = semmap(url, "manipulation", "add-robot", urdf("tiago"), "--name", "tiago")
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
    base = Pose.planar(5.1, 0.95, 0.0).matrix

    def pose(joints: list[str], position: list[float]) -> Any:
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
    np.testing.assert_allclose(pose[:3, :3], Pose(*other).rotation, atol=0.02)


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
        assert not touches(kitchen.corners @ item[:3, :3].T + item[:3, 3], *TOP)
    near(palms(joints, row["to_pre_place"][-1]), row["pre_pose"])
    near(palms(joints, carried[-1]) @ in_hand, row["spot"])
    near(palms(joints, row["retreat_positions"][-1]), row["post_pose"])
    lowest = (kitchen.corners @ Pose(*row["spot"]).rotation.T)[:, 2].min() + row["spot"][2]
    assert 0.801 < lowest < 0.806
    (again,) = rows(kitchen, *words, "--base", BASE, "--plan")
    assert again["path"] == row["path"]


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
    assert semmap(kitchen.url, "push", "can", "--robot", "tiago", *both).exit_code == 2
    assert semmap(kitchen.url, "place", "can", "--on", TABLE, "--plan", *both).exit_code == 2
