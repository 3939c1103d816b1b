"""Plans of a robot whose arm extends to its right, checked with the kinematics of yourdfpy.

A Stretch RE2 lifts its arm, extends it and turns the wrist about the vertical; its gripper slants
by 30 degrees. So it gets to a grasp from a few places alone, all with the object beside it. Other
wrists turn about more axes. The URDF of an SE3 states no limits of the fingers.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import trimesh
import yourdfpy
from scipy.optimize import least_squares

import semmap
from planner.tasks import NoPlanError
from semmap.geometry.pose import Pose
from semmap.manipulation.arm import Arm
from semmap.manipulation.candidates import grasp_candidates
from semmap.manipulation.gripper_reader import read_gripper
from semmap.manipulation.stances import Stances
from tests.command_line import semmap as command
from tests.effort import effort
from tests.manipulation.grippers import Shape
from tests.robot.robots import installed_file

STRETCH = "RE2V0/stretch_description_RE2V0_tool_stretch_gripper.urdf"
WRIST = "RE2V0/stretch_description_RE2V0_tool_stretch_dex_wrist.urdf"
SE3 = "SE3/stretch_description_SE3_eoa_wrist_dw3_tool_sg3.urdf"
NO_TOOL = "SE3/stretch_description_SE3_eoa_wrist_dw3_tool_nil.urdf"
CUP = 0.035, 0.1
"""Radius and height, metres."""


class Hall(NamedTuple):
    """Two tables by name: x, y, height of the top, heading; and how the robot's frame is turned."""

    tables: dict[str, tuple[float, float, float, float]]
    size: tuple[float, float]
    turn: float
    file: str = STRETCH


HALLS = {
    "right": Hall(
        {"Zwiebelbrett": (1.5, 2.4, 0.72, 0.3), "mesita_b": (4.4, 1.3, 0.62, 1.2)}, (0.7, 0.7), 0.0
    ),
    "ahead": Hall(
        {"Hobelbank 7": (1.2, 1.0, 0.8, -0.2), "comptoir": (4.6, 3.6, 0.5, 0.9)}, (0.9, 0.6), 90.0
    ),
    "wrist": Hall(
        {"Küchentisch": (1.3, 2.6, 0.75, 0.8), "étagère": (4.5, 3.3, 0.95, 0.1)},
        (0.8, 0.6),
        0.0,
        WRIST,
    ),
    "se3": Hall(
        {"banco 2": (4.2, 2.2, 0.55, 0.4), "Stehtisch": (1.4, 3.0, 0.9, -0.5)},
        (0.8, 0.6),
        0.0,
        SE3,
    ),
}


def stretch(folder: Path, file: str, turn: float = 0.0) -> Path:
    """A Stretch whose frame is turned, degrees: at 90 its arm reaches ahead."""
    path = installed_file("hello-robot-stretch-urdf", file)
    text = path.read_text().replace('filename="./', f'filename="{path.parent}/')
    root = (
        '<link name="turned"/><joint name="turn" type="fixed"><parent link="turned"/>'
        f'<child link="base_link"/><origin rpy="0 0 {math.radians(turn)}"/></joint>'
    )
    made = folder / "stretch.urdf"
    made.write_text(text.replace("</robot>", f"{root}</robot>"))
    return made


class Chain:
    """The arm by yourdfpy: poses of the grasp frame in the robot's frame."""

    def __init__(self, urdf: Path) -> None:
        self.arm = Arm(read_gripper(urdf))
        self.names = [joint.name for joint in self.arm.joints]
        self.robot = yourdfpy.URDF.load(
            str(urdf), load_meshes=False, filename_handler=lambda file: file
        )
        base = self.robot.base_link
        self.root = self.arm.robot.link_poses({}, [base])[base]
        limits = [self.robot.joint_map[name].limit for name in self.names]
        self.low = np.array([limit.lower for limit in limits])
        self.high = np.array([limit.upper for limit in limits])

    def pose(self, position: Any) -> Any:
        """Of a position within the limits of the joints."""
        assert ((position >= self.low - 1e-6) & (position <= self.high + 1e-6)).all()
        self.robot.update_cfg(dict(zip(self.names, map(float, position), strict=True)))
        palm = self.robot.get_transform(self.arm.gripper.palm)
        return self.root @ palm @ self.arm.gripper.frame

    def apart(self, pose: Any, wanted: Any) -> Any:
        """(12,) metres and differences of axes between two poses."""
        return (pose - wanted)[:3].ravel()

    def reaches(self, wanted: Any) -> bool:
        """Whether a minimiser brings the grasp frame to a pose, robot's frame, within 1 mm."""
        random = np.random.default_rng(0)
        found = (
            least_squares(
                lambda q: self.apart(self.pose(np.clip(q, self.low, self.high)), wanted),
                random.uniform(self.low + 1e-6, self.high - 1e-6),
                bounds=(self.low, self.high),
                max_nfev=60,
            )
            for _ in range(6)
        )
        return any(np.abs(each.fun).max() < 1e-3 for each in found)


def assert_near(pose: Any, wanted: Any) -> None:
    """Two poses are within 1 cm and 3 degrees."""
    assert np.linalg.norm(pose[:3, 3] - wanted[:3, 3]) < 0.01
    cosine = (np.trace(pose[:3, :3].T @ wanted[:3, :3]) - 1) / 2
    assert cosine > math.cos(math.radians(3))


@pytest.fixture(params=HALLS)
def hall(request: pytest.FixtureRequest) -> Hall:
    return HALLS[request.param]


@pytest.fixture
def urdf(hall: Hall, tmp_path: Path) -> Path:
    return stretch(tmp_path, hall.file, hall.turn)


@pytest.fixture
def here(hall: Hall, urdf: Path, database: str) -> Iterator[semmap.Map]:
    """A hall with two tables, the first with a cup on it."""
    with semmap.connect(database) as db:
        made = db.create_map("hall")
        made.add_storey("ground", elevation=0, height=3)
        made.add_room("Saal", [(0, 0), (6, 0), (6, 5), (0, 5)], floor=0, ceiling=2.7)
        made.add_room("Flur", [(6.2, 0), (8, 0), (8, 5), (6.2, 5)], floor=0, ceiling=2.7)
        made.add_door("Tür", "Saal", "Flur", line=((6.1, 2), (6.1, 3)))
        for name, (x, y, z, yaw) in hall.tables.items():
            made.add_object(name, type="table", size=(*hall.size, z), pose=(x, y, 0, yaw))
        x, y, z, yaw = next(iter(hall.tables.values()))
        made.add_object("Tässchen", type="cup", mesh=cup(), pose=(x, y + 0.05, z, yaw + 0.5))
        db.add_robot("stretch", urdf)
        yield made


def cup() -> trimesh.Trimesh:
    shape = trimesh.creation.cylinder(*CUP, sections=24)
    shape.apply_translation((0, 0, CUP[1] / 2))
    return shape


def base_of(plan: Any, action: str) -> Pose:
    (pose,) = (step.at for step in plan.actions if step.name == action)
    assert pose is not None
    return Pose(*pose)


def planned(database: str, base: Pose, *words: str) -> dict[str, Any]:
    """The action of a robot that stands somewhere, with the motion of its arm."""
    there = ("--robot", "stretch", "--base", f"{base.x},{base.y},{base.yaw}")
    told = command(database, *words, *there, "--plan", "--map", "hall", "--json")
    assert told.exit_code == 0, told.output
    row: dict[str, Any] = json.loads(told.stdout)[0]
    return row


def test_it_fetches_a_cup_with_the_table_beside_it(
    here: semmap.Map, hall: Hall, urdf: Path, database: str, tmp_path: Path
) -> None:
    source, target = hall.tables
    chain = Chain(urdf)
    goal: Any = (f"on(Tässchen, {target})",)
    options: Any = {"start": "Saal", "robot": "stretch"}
    plan = here.plan(*goal, **options)
    stored = [row["name"] for row in here.database.list_grippers()]
    assert not any("stretch" in name for name in stored)  # a plan stores nothing
    assumed = [each for each in plan.reasons if "states no limits of the finger joints" in each]
    assert len(assumed) == (hall.file == SE3)
    bases = {action: base_of(plan, action) for action in ("pickup", "place")}
    for action, table in (("pickup", source), ("place", target)):
        base, (x, y) = bases[action], hall.tables[table][:2]
        assert (base.z, base.qx, base.qy) == (0, 0, 0)
        bearing = math.atan2(y - base.y, x - base.x) - base.yaw
        assert math.cos(bearing - math.radians(hall.turn - 90)) > 0.6
    told = command(database, "manipulation", "add-robot", urdf, "--name", "stretch")
    assert told.exit_code == 0, told.output

    row = planned(database, bases["pickup"], "grasp", "Tässchen")
    for key, positions in (("pre_pose", "to_pre_grasp"), ("pose", "approach_positions")):
        order = [row["joints"].index(name) for name in chain.names]
        reached = chain.pose(np.array(row[positions][-1])[order])
        assert_near(bases["pickup"].matrix @ reached, Pose(*row[key]).matrix)
    ((x, y, z),) = here.execute(
        "SELECT pose[1], pose[2], pose[3] FROM world WHERE entity_id = entity_id('Tässchen')"
    )
    fingers = Pose(*row["pose"]).matrix[:3, 3]
    assert math.hypot(fingers[0] - x, fingers[1] - y) < 0.06  # they reach further closed
    assert z < fingers[2] < z + CUP[1]

    row = planned(database, bases["place"], "place", "Tässchen", "--on", target)
    order = [row["joints"].index(name) for name in chain.names]
    reached = bases["place"].matrix @ chain.pose(np.array(row["approach_positions"][-1])[order])
    in_hand = np.linalg.inv(Pose(*row["model_pose"]).matrix)
    spot = reached @ in_hand
    assert_near(spot, Pose(*row["spot"]).matrix)
    x, y, top, yaw = hall.tables[target]
    aside = Pose.planar(x, y, yaw).inverse().apply(spot[None, :3, 3])[0, :2]
    assert (np.abs(aside) + CUP[0] < np.array(hall.size) / 2).all()
    assert 0 < spot[2, 3] - top < 0.01

    ended = here.run(*goal, **options, speed=1e5, world=tmp_path / "w.sqlite")
    assert ended.state == "done", ended.reason
    ((holder,),) = here.database.map(ended.map).execute(
        "SELECT h.name FROM placement p JOIN entity h ON h.id = p.holder_id "
        "WHERE p.entity_id = entity_id('Tässchen')"
    )
    assert holder == target


@pytest.mark.explore
@pytest.mark.parametrize("hall", effort(["right", "ahead"], [*HALLS]), indirect=True)
def test_what_is_out_of_its_reach_is_said_with_the_side(here: semmap.Map, hall: Hall) -> None:
    here.add_object("Tafel", type="table", size=(2.6, 1.9, 0.7), pose=(3.2, 2.2, 0, 0))
    here.add_object("Henkel", type="cup", mesh=cup(), pose=(3.2, 2.2, 0.7))
    side = {0.0: "to its right", 90.0: "ahead"}[hall.turn]
    said = rf"Henkel is out of reach: the arm of stretch takes Henkel by no grasp.* reaches {side}"
    with pytest.raises(NoPlanError, match=said):
        here.plan("carries(robot, Henkel)", start="Saal", robot="stretch")


@pytest.mark.parametrize("hall", ["right", "ahead"], indirect=True)
def test_from_its_stances_an_arm_gets_along_the_grasps_of_a_cup(urdf: Path) -> None:
    """A minimiser of SciPy finds positions of the joints for each pose of a way."""
    chain = Chain(urdf)
    arm = chain.arm
    assert arm.needs_base
    stands = Pose.planar(2.0, -1.0, 0.7, 0.9).matrix
    pose = np.eye(4)
    pose[2, 3] = CUP[1] / 2
    grasps = grasp_candidates(Shape("cylinder", CUP, pose), arm.gripper)
    ways = [
        (stands @ before, stands @ there)
        for before, there in zip(grasps.pre_grasps, grasps.poses, strict=True)
        if arm.gripper.can_tilt_to(stands @ there)
    ]
    assert len(ways) > 20
    stances, random = Stances(arm), np.random.default_rng(3)
    for number in random.choice(len(ways), 3, replace=False):
        found = stances.along(ways[number], floor=0.1)
        assert len(found) > 5
        for base in [found[i] for i in random.choice(len(found), 2, replace=False)]:
            assert (base.z, base.qx, base.qy) == pytest.approx((0.1, 0, 0))
            inverse = np.linalg.inv(base.matrix)
            assert all(chain.reaches(inverse @ each) for each in ways[number])
            aside = base.matrix @ Pose.planar(0.03, 0.05, 0.0).matrix
            assert not all(chain.reaches(np.linalg.inv(aside) @ each) for each in ways[number])


@pytest.mark.parametrize("hall", ["se3"], indirect=True)
def test_a_plan_says_that_an_arm_without_a_known_gripper_is_not_judged(here: semmap.Map) -> None:
    here.database.add_robot("bare", installed_file("hello-robot-stretch-urdf", NO_TOOL))
    tables = [e.name for e in here.objects if e.is_a("table")]
    there = next(name for name in tables if name != here["Tässchen"].holder.name)  # type: ignore[union-attr]
    plan = here.plan(f'on("Tässchen", "{there}")', start="Flur", robot="bare")
    assert any("an arm of bare reaches there is not judged" in each for each in plan.reasons)
