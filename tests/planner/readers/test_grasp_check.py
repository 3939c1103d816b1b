"""What plans say of objects that a gripper cannot take, and of objects that missions gave up."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import semmap
from planner.live_topology import LiveTopology
from planner.task_planner import TaskPlanner
from planner.tasks import NoPlanError
from planner.tasks.world import UnknownObjectError
from semmap import Map
from semmap.manipulation.retrieval import DEFAULT_GRIPPER
from tests.robot.robots import real_robot


@pytest.fixture
def room(database: str) -> Iterator[Map]:
    """A room with a table, two large crates and a small cube."""
    with semmap.connect(database) as db:
        made = db.create_map("room")
        made.add_storey("ground", elevation=0, height=3)
        made.add_room("hall", [(0, 0), (6, 0), (6, 5), (0, 5)], floor=0, ceiling=2.7)
        made.add_room("yard", [(6.2, 0), (9, 0), (9, 5), (6.2, 5)], floor=0, ceiling=2.7)
        made.add_door("door", "hall", "yard", line=((6.1, 2), (6.1, 3)))
        made.add_object("table", type="table", size=(1.2, 0.8, 0.75), pose=(1, 1, 0, 0))
        for name, x, side in (("crate1", 3, 0.3), ("crate2", 4, 0.3), ("dice", 5, 0.04)):
            kind = name.rstrip("12")
            made.add_object(name, type=kind, size=(side,) * 3, pose=(x, 3, 0, 0), define=True)
        yield made


def test_a_plan_without_a_robot_judges_by_the_gripper_of_missions(
    room: Map, tmp_path: Path
) -> None:
    """It is refused with the reason of the mission; the answer says which gripper is assumed."""
    with pytest.raises(NoPlanError) as refused:
        room.plan("on(crate1, table)", start="hall")
    assert "crate1: no grasp fits its shape (cuboid 0.3 x 0.3 x 0.3 m)" in str(refused.value)
    assert "gripper parallel_gripper opens 0.09 m" in str(refused.value)
    assert "parallel_gripper is assumed: gripper= names another one" in str(refused.value)
    plan = room.plan("on(dice, table)", start="hall")
    assert plan.reasons == ()
    ended = room.run("on(crate1, table)", start="hall", speed=200.0, world=tmp_path / "w.sqlite")
    assert ended.state == "failed"
    assert str(refused.value).partition("crate1: ")[2] in str(ended.reason)


@pytest.mark.parametrize("preferred", [False, True])
def test_the_preferred_gripper_decides_in_plans_and_missions(
    room: Map, tmp_path: Path, preferred: bool
) -> None:
    wide = DEFAULT_GRIPPER.read_text().replace('upper="0.045"', 'upper="0.2"')
    assert wide != DEFAULT_GRIPPER.read_text()
    urdf = tmp_path / "wide.urdf"
    urdf.write_text(wide)
    room.database.add_gripper(urdf, "wide", prefer=preferred)
    room.database.add_gripper(DEFAULT_GRIPPER, "small", prefer=False)
    if preferred:
        plan = room.plan("on(crate1, table)", start="hall")
        assert plan.options["gripper"] is None
        with pytest.raises(NoPlanError, match="gripper small opens"):
            room.plan("on(crate1, table)", start="hall", gripper="small")
    else:
        plan = room.plan("on(crate1, table)", start="hall")
        (said,) = plan.reasons
        assert said.startswith("the grasps of crate1 are not judged: there are several grippers")
        with pytest.raises(LookupError, match="several grippers"):
            plan.run(world=tmp_path / "w.sqlite")
        assert room.plan("on(crate1, table)", start="hall", gripper="wide").reasons == ()


def test_an_unknown_gripper_is_refused(room: Map) -> None:
    with pytest.raises(LookupError, match="no gripper claw"):
        room.plan("on(dice, table)", start="hall", gripper="claw")


def test_what_has_no_shape_is_not_judged(room: Map) -> None:
    room.add_object("ghost", type="mug", pose=(5, 4, 0.75))
    (said,) = room.plan("on(ghost, table)", start="hall").reasons
    assert said.startswith("the grasps of ghost are not judged: ghost: has no mesh")


def test_what_is_left_out_is_not_said_to_be_unknown(room: Map) -> None:
    live = LiveTopology(room)
    tasks = TaskPlanner(live)
    with live.snapshot() as seen:

        def problem(goal: str, *without: str) -> str:
            with pytest.raises((NoPlanError, UnknownObjectError)) as error:
                tasks.task(seen, goal, "hall", without=frozenset(without)).plan()
            return str(error.value)

        assert problem("on(crate1, table)", "crate1") == "the goal needs crate1"
        assert problem("on(dice, table)", "table") == "the goal needs table"
        both = problem("on(crate, table)", "crate1", "crate2")
        assert both == "the goal needs crate1 and crate2, and there is no other crate"
        assert problem("on(crat, table)", "crate1").startswith("there is no crat: no object")
        assert "crate2: no grasp fits" in problem("on(crate, table)", "crate1")


def test_the_gripper_of_another_robot_is_not_used(room: Map, tmp_path: Path) -> None:
    """A TIAGo opens 7 cm; what it stored of its gripper changes no plan of the other robot."""
    room.add_object("cube", type="cube", size=(0.08,) * 3, pose=(5, 4, 0), define=True)
    room.database.add_robot("tiago", real_robot("tiago"))
    ran = room.run("carries(robot, dice)", start="hall", robot="tiago", speed=500.0)
    assert [g["name"] for g in room.database.list_grippers()] == ["tiago_gripper"], ran
    with pytest.raises(NoPlanError, match=r"tiago_gripper opens 0\.07"):
        room.plan("on(cube, table)", start="hall", robot="tiago")
    assert room.plan("on(cube, table)", start="hall").reasons == ()
    ended = room.run("on(cube, table)", start="hall", speed=200.0, world=tmp_path / "w.sqlite")
    assert ended.state == "done"
