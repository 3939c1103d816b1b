"""What plans say of objects that a gripper cannot take, and of objects that missions gave up."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import semmap
from planner.live_topology import LiveTopology
from planner.readers.grasp_check import assumed_misfits
from planner.task_planner import TaskPlanner
from planner.tasks import NoPlanError
from planner.tasks.world import UnknownObjectError
from semmap import Map


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


def test_a_plan_says_that_missions_without_a_gripper_cannot_take_it(room: Map) -> None:
    plan = room.plan("on(crate1, table)", start="hall")
    assert [action.name for action in plan.actions] == ["pickup", "place"]
    (said,) = plan.reasons
    assert said.startswith("crate1: no grasp fits its shape (cuboid 0.3 x 0.3 x 0.3 m); gripper")
    assert "opens 0.09 m" in said
    assert room.plan("on(dice, table)", start="hall").reasons == ()


def test_it_is_what_the_mission_then_finds(room: Map, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    ended = room.run("on(crate1, table)", start="hall", speed=200.0, world=tmp_path / "w.sqlite")
    assert ended.state == "failed"
    assert room.plan("on(crate1, table)", start="hall").reasons[0].split(". A robot")[0] in str(
        ended.reason
    )
    assert str(ended.reason).endswith("without crate1: the goal needs crate1")


def test_a_stored_gripper_is_the_one_that_is_said(room: Map) -> None:
    with room.snapshot() as seen:
        assert assumed_misfits(seen, []) == []
        (said,) = assumed_misfits(seen, ["crate1", "dice"])
        assert "gripper parallel_gripper opens" in said


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
        assert tasks.task(seen, "on(crate, table)", "hall", without=frozenset({"crate1"})).plan()
