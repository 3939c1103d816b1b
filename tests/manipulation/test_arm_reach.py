"""From which bases a Panda takes a cup and puts it down, where a wall is between or none.

The wall is the judge: it is larger than the arm, so that no posture of the arm gets past it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from planner.mission.grasp_choice import GraspChooser, Hand
from semmap import Map
from semmap.geometry.pose import Pose
from semmap.manipulation.arm_motions import FreeArm
from semmap.manipulation.arm_reach import ArmReach, GraspReach, PutReach
from semmap.manipulation.automata import register_robot, stored_arm
from semmap.manipulation.places import PutDowns, find_places
from semmap.manipulation.retrieval import find_grasps
from semmap.manipulation.surroundings import Surroundings
from tests.manipulation.grippers import urdf
from tests.seen import seen_by

BASE = Pose.planar(0.85, 1.0, 0.6, 0.7)


@pytest.fixture
def here(cups: Map) -> Any:
    """The map's session, in which a Panda is stored."""
    register_robot(cups.connection, urdf("panda"), "panda")
    return cups.connection


def grasps(here: Any) -> list[dict[str, Any]]:
    return find_grasps(seen_by(here), name="cup1", gripper="panda_gripper", limit=200).rows


def taking(here: Any) -> ArmReach:
    return GraspReach(seen_by(here), grasps(here), stored_arm(here, "panda")[1])


def putting(here: Any) -> ArmReach:
    arm = stored_arm(here, "panda")[1]
    return PutReach(
        seen_by(here),
        [(PutDowns(seen_by(here), "cup1", "table", arm.gripper), grasps(here))],
        arm,
    )


def build_wall(cups: Map) -> None:
    """Half way from the base to the cup, 3 m wide and high."""
    cup = cups["cup1"].pose
    yaw = math.atan2(cup.y - BASE.y, cup.x - BASE.x)
    x, y = (BASE.x + cup.x) / 2, (BASE.y + cup.y) / 2
    cups.add_object("screen", type="box", size=(0.01, 3, 3), pose=(x, y, 0, yaw))


@pytest.mark.parametrize("reach", [taking, putting])
def test_no_base_behind_a_wall(cups: Map, here: Any, reach: Callable[[Any], ArmReach]) -> None:
    assert reach(here).cost(BASE) is not None
    assert reach(here).cost(Pose.planar(3.5, 1.0, 0.0)) is None
    build_wall(cups)
    assert reach(here).cost(BASE) is None


@pytest.mark.parametrize("reach", [taking, putting])
def test_no_base_where_the_arm_meets_something_as_it_is_carried(
    cups: Map, here: Any, reach: Callable[[Any], ArmReach]
) -> None:
    """A block where the hand is carried, off the cup and the table."""
    arm = stored_arm(here, "panda")[1]
    x, y, z = (BASE.matrix @ arm.grasp_pose(arm.rest()))[:3, 3].tolist()
    assert reach(here).cost(BASE) is not None
    cups.add_object("block", type="box", size=(0.06, 0.06, 0.06), pose=(x, y, z - 0.03, 0))
    assert reach(here).cost(BASE) is None


def test_the_wall_leaves_the_hand_free(cups: Map, here: Any) -> None:
    """Only the arm meets it: without its collisions, the base behind it would do."""
    build_wall(cups)
    rows = grasps(here)
    arm = stored_arm(here, "panda")[1]
    assert Surroundings(seen_by(here), arm.gripper).free(rows).all()
    assert list(FreeArm(seen_by(here), arm).rows(BASE, rows[:40])) == []


def test_a_base_that_is_planned_for_a_place_does_it(cups: Map, here: Any) -> None:
    """Where plans say that the cup is put down, places are found and are as many as asked for."""
    arm = stored_arm(here, "panda")[1]
    there = putting(here)
    said = [there.cost(base) is not None for base in (BASE, Pose.planar(3.6, 0.3, 0, 0.7))]
    found = [
        find_places(
            seen_by(here), "cup1", "table", gripper="panda_gripper", arm=arm, base=base, limit=1
        ).rows
        for base in (BASE, Pose.planar(3.6, 0.3, 0, 0.7))
    ]
    assert said == [bool(rows) for rows in found] == [True, False]


@pytest.mark.parametrize("y", [2.1, 2.4])
def test_a_grasp_is_taken_with_which_the_arm_can_put_down(here: Any, y: float) -> None:
    """Where the robot stands high, the best grasp is none of those."""
    at = Pose.planar(1.5, y, -1.57, 1.1)
    arm = stored_arm(here, "panda")[1]
    chooser = GraspChooser(seen_by(here), "panda", Hand("panda_gripper", "panda"), BASE)
    choice = chooser.grasp("cup1", "table", at)
    assert choice.action is not None
    places = find_places(
        seen_by(here),
        "cup1",
        "table",
        gripper="panda_gripper",
        grasps=[choice.action],
        arm=arm,
        base=at,
    )
    assert places.rows
