"""Plans for a TIAGo in the small house stand where its arm acts, or say that it cannot.

How far the arm gets is found with the kinematics of yourdfpy and a minimiser of SciPy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yourdfpy
from scipy.optimize import least_squares
from sqlalchemy import Engine

import semmap
from planner.live_topology import LiveTopology
from planner.route_planner import RoutePlanner
from planner.task_planner import TaskPlanner
from planner.tasks import NoPlanError
from semmap.geometry.pose import Pose
from semmap.manipulation.arm import Arm
from tests.command_line import semmap as command
from tests.effort import effort
from tests.manipulation.grippers import real_gripper, urdf
from tests.worlds.test_arms_small_house import FOLDED, Kitchen, near, rows

CAN = Path("ycb/meshes/005_tomato_soup_can_textured.gltf")
TOP = 0.80135
SPOTS = {"edge": (5.86, 0.87, TOP), "inner": (6.15, 0.95, TOP), "middle": (6.5, 0.95, TOP)}
"""Where cans stand on the kitchen table, which has chairs on its long sides."""
HALF = 0.06
"""Metres between the middle of a can and the grasp frame at any of its grasps, at most."""


@pytest.fixture(scope="module")
def kitchen(house: Engine, worlds: Path) -> Kitchen:
    """The small house with three cans; the database knows a TIAGo and its class."""
    url = house.url.render_as_string(hide_password=False)
    with semmap.connect(url) as db:
        for name, pose in SPOTS.items():
            db.map("house").add_object(name, type="can", mesh=worlds / CAN, pose=pose)
        reach: Any = {"reach": (0.2, 1.2), "heights": (0.0, 2.5)}
        db.add_robot("tiago", urdf("tiago"), posture=FOLDED, **reach)
    told = command(url, "manipulation", "add-robot", urdf("tiago"), "--name", "tiago")
    assert told.exit_code == 0, told.output
    return Kitchen(url, {})


@pytest.fixture
def house_map(kitchen: Kitchen) -> Iterator[semmap.Map]:
    with semmap.connect(kitchen.url) as db:
        yield db.map("house")


class Chain:
    """The arm by yourdfpy: poses of the grasp frame in the robot's frame."""

    def __init__(self) -> None:
        self.arm = Arm(real_gripper("tiago"))
        self.names = [joint.name for joint in self.arm.joints]
        self.robot = yourdfpy.URDF.load(
            str(urdf("tiago")), load_meshes=False, filename_handler=lambda file: file
        )
        base = self.robot.base_link
        self.root = self.arm.robot.link_poses({}, [base])[base]

    def pose(self, position: Any) -> Any:
        self.robot.update_cfg(dict(zip(self.names, map(float, position), strict=True)))
        palm = self.robot.get_transform(self.arm.gripper.palm)
        return self.root @ palm @ self.arm.gripper.frame

    def distance(self, point: Any, starts: int = 4) -> float:
        """How near the grasp frame gets to a point (3,), metres."""
        random = np.random.default_rng(0)
        low, high = self.arm.low, self.arm.high
        found = [
            least_squares(
                lambda q: self.pose(q)[:3, 3] - point,
                random.uniform(low, high),
                bounds=(low, high),
                max_nfev=25,
            )
            for _ in range(starts)
        ]
        return min(float(np.linalg.norm(each.fun)) for each in found)


@pytest.fixture(scope="module")
def chain() -> Chain:
    return Chain()


def base_of(plan: Any, action: str) -> Pose:
    (pose,) = (step.at for step in plan.actions if step.name == action)
    assert pose is not None
    return Pose(*pose)


def given(base: Pose) -> str:
    return f"{base.x},{base.y},{base.yaw}"


def unasked(house_map: semmap.Map, goal: str) -> Any:
    """The plan for a gripper that is named: its arm is not known."""
    live = LiveTopology(house_map, "tiago")
    with live.snapshot() as seen:
        return TaskPlanner(live, gripper="tiago_gripper").task(seen, goal, "kitchen").plan()


def quickest(kitchen: Kitchen, house_map: semmap.Map, chain: Chain, name: str, base: Pose) -> float:
    """The least seconds of the joint that moves longest to a grasp, by its expected successes."""
    words = ("grasp", name, "--robot", "tiago", "--limit", 40, "--base", given(base))
    ((rest,),) = house_map.execute("SELECT posture FROM automaton WHERE name = 'tiago'")
    joints = chain.robot.joint_map
    most = {"prismatic": 0.1}
    speeds = {n: min(most.get(joints[n].type, 1.0), joints[n].limit.velocity) for n in chain.names}
    costs = [
        max(abs(row["position"][n] - rest[n]) / speeds[n] for n in chain.names) / row["expected"]
        for row in rows(kitchen, *words)
    ]
    return min(costs)


@pytest.mark.parametrize("name", ["edge", "inner"])
def test_a_plan_stands_where_the_arm_grasps(
    kitchen: Kitchen, house_map: semmap.Map, chain: Chain, name: str
) -> None:
    goal = f"carries(robot, {name})"
    base = base_of(house_map.plan(goal, start="kitchen", robot="tiago"), "pickup")
    words = ("grasp", name, "--robot", "tiago", "--limit", 1, "--base")
    (row,) = rows(kitchen, *words, given(base))
    reached = chain.pose([row["position"][joint] for joint in chain.names])
    near(base.matrix @ reached, row["pre_pose"])
    first = base_of(unasked(house_map, goal), "pickup")
    there = command(kitchen.url, *words, given(first), "--map", "house", "--json")
    nothing = there.exit_code != 0
    assert nothing == (name == "inner")  # is reached from the pose of the least costs
    if nothing:
        assert math.dist(first[:2], base[:2]) > 0.01
    else:
        least = quickest(kitchen, house_map, chain, name, first)
        assert quickest(kitchen, house_map, chain, name, base) < 1.1 * least  # by a few grasps


def test_what_the_arm_cannot_take_is_refused(
    house_map: semmap.Map, chain: Chain, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    goal, start = "on(middle, CoffeeTable_01_001)", {"start": "kitchen", "robot": "tiago"}
    reason = r"middle is out of reach: the arm of tiago takes middle by no grasp"
    with pytest.raises(NoPlanError, match=reason):
        house_map.plan(goal, **start)
    bases = RoutePlanner.of_map(house_map, "tiago").approach("middle")
    assert bases
    point = np.array(SPOTS["middle"]) + np.array([0.0, 0.0, 0.05])
    for base in bases[:: max(1, len(bases) // 3)]:
        there = base.inverse().apply(point[None])[0]
        assert chain.distance(there) > HALF
    ended = house_map.run(goal, **start, speed=1e5, try_grasps=False)
    assert (ended.state, ended.steps) == ("failed", [])
    assert "the arm of tiago" in ended.reason


@pytest.mark.explore
@pytest.mark.parametrize("target", ["Refrigerator_01_001", *effort([], ["Wardrobe_01_001"])])
def test_nothing_is_put_where_the_gripper_does_not_get(
    house_map: semmap.Map, chain: Chain, target: str
) -> None:
    """The tops are 1.96 and 2.14 m high; a robot class says 2.5 m of itself."""
    goal, start = f"on(edge, {target})", {"start": "kitchen", "robot": "tiago"}
    assert unasked(house_map, goal).actions
    reason = f"{target} is out of reach: the arm of tiago gets over no part of {target}"
    with pytest.raises(NoPlanError, match=reason):
        house_map.plan(goal, **start)
    top = "SELECT ST_ZMax(box) FROM world WHERE entity_id = entity_id(%s)"
    ((height,),) = house_map.execute(top, target)
    for away in (0.2, 0.5, 0.8):
        assert chain.distance(np.array([away, 0.0, height + 0.05]), starts=2) > 0.02
    assert house_map.plan("on(edge, NightStand_01_001)", **start).actions
