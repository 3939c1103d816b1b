"""Plans with objects that are believed elsewhere than the map has them, or that have no place."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

import semmap
from planner.search.problem_builder import Detector
from planner.search.search_mission import NotFoundError, SearchPlanner
from planner.search.task_search import SearchingPlanner, plan_with_search
from planner.task_planner import TaskPlanner
from semmap import Database, Map
from semmap.belief.store.beliefs import ELSEWHERE
from tests.office import delivery_robot


@pytest.fixture
def flat(database: str) -> Iterator[Map]:
    """Two rooms with a door; a ball on the floor of the second one."""
    with semmap.connect(database) as db:
        yield made(db)


def made(db: Database) -> Map:
    house = db.create_map("doubt")
    house.add_storey("ground", elevation=0, height=3)
    house.add_room("kitchen", [(0, 0), (5, 0), (5, 5), (0, 5)], floor=0, ceiling=2.7)
    house.add_room("living", [(5.2, 0), (11, 0), (11, 5), (5.2, 5)], floor=0, ceiling=2.7)
    house.add_door("door", "kitchen", "living", line=((5.1, 2), (5.1, 3)))
    for name, x, y in (("table1", 1, 1), ("table2", 9, 4)):
        house.add_object(name, type="table", size=(1.2, 0.8, 0.75), pose=(x, y, 0, 0))
    house.add_object("ball", type="ball", size=(0.06, 0.06, 0.06), pose=(8, 1, 0, 0))
    return house


def words(flat: Map, goal: str) -> list[str]:
    return [str(action) for action in flat.plan(goal, start="kitchen").actions]


@pytest.mark.parametrize("shaped", [False, True])
def test_an_object_is_fetched_where_it_is_believed(flat: Map, shaped: bool) -> None:
    robot = delivery_robot("tester") if shaped else None
    flat.observe("ball", "table1")
    assert flat.where("ball")["table1"] > 0.99
    assert str(flat["ball"].room.name) == "living", "a place without a point moves nothing"
    plan = flat.plan("on(ball, table2)", start="kitchen", robot=robot)
    assert [a.name for a in plan.actions] == ["search", "pickup", "pass_door", "place"]
    assert plan.actions[1].arguments == ("ball", "table1")
    if shaped:
        at = plan.actions[1].at
        assert at is not None
        assert math.dist(at[:2], (1, 1)) < 1.5, "before the table"
    assert plan.reasons[-1] == "What follows is for ball at table1"


def test_a_goal_that_only_the_map_has_reached_is_still_one(flat: Map) -> None:
    flat["ball"].put_on("table2")
    assert words(flat, "on(ball, table2)") == []
    flat.observe("ball", "table1")
    actions = flat.plan("on(ball, table2)", start="kitchen").actions
    assert [a.name for a in actions] == ["search", "pickup", "pass_door", "place"]


def test_an_object_without_a_place_is_searched_for_and_then_fetched(flat: Map) -> None:
    while flat["ball"].pose is not None:
        flat.observe("ball", "living", seen=False)
    plan = flat.plan("on(ball, table2)", start="kitchen")
    assert plan.actions[0].name == "search"
    assert [a.name for a in plan.actions if a.name in ("pickup", "place")] == ["pickup", "place"]
    (at,) = (a.arguments[1] for a in plan.actions if a.name == "pickup")
    likely = [place for place in flat.where("ball") if place != ELSEWHERE]
    assert at in likely[:4]
    assert plan.reasons[-1] == f"What follows is for ball at {at}"


def test_no_place_from_which_a_plan_leads_on_is_said(flat: Map) -> None:
    flat.add_object("block", type="cube", size=(0.9, 0.9, 0.9), define=True)
    flat.observe("block", "kitchen")
    with pytest.raises(ValueError, match=r"block is 0\.90 m wide; the robot lifts objects up to"):
        flat.plan("on(block, table2)", start="kitchen")


def test_a_plan_that_only_finds_refuses_where_no_look_is_worth_its_time(flat: Map) -> None:
    flat.observe("ball", "living", seen=False)
    live = flat.live_topology()
    search = SearchPlanner(live, detector=Detector(missed=0.5))
    with live.snapshot() as seen, pytest.raises(NotFoundError, match=r"ball: .*is worth its time"):
        plan_with_search(seen, TaskPlanner(live), search, "found(ball)", "kitchen", patience=5.0)


def test_what_is_not_found_without_a_busy_door_is_searched_for_once_it_is_free(flat: Map) -> None:
    """Cup 1 is behind the door, and its place is surer than that of cup 2."""
    for name, pose in (("cup1", (8, 3, 0, 0)), ("cup2", (2, 4, 0, 0))):
        flat.add_object(name, type="cup", size=(0.06, 0.06, 0.06), pose=pose)
    flat.observe("cup1", "table2")
    flat.observe("cup2", "table1")
    flat.observe("cup2", "table1", seen=False)
    flat.add_agent("robot", type="robot", size=(0.4, 0.4, 0.8), pose=(3, 3, 0, 0))
    live = flat.live_topology()
    search = SearchPlanner(live, detector=Detector(missed=25.0))
    planner = SearchingPlanner(TaskPlanner(live), search)

    def looked_for(without: frozenset[str]) -> list[str]:
        with live.snapshot() as seen:
            plan = planner(seen, "robot", "on(cup, table1)", without=without)
        return [action.arguments[0] for action in plan.actions if action.name == "look"]

    free, busy = frozenset[str](), frozenset(["door"])
    assert looked_for(free) == ["cup1"]
    assert looked_for(busy) == ["cup2"]  # as the runner plans while another robot has the door
    assert not search.answers["cup1"].found
    assert looked_for(free) == ["cup1"]
    assert "cup1" not in search.answers


def test_a_search_goes_through_a_door_once_it_is_free_and_not_while_it_is_left_out(
    flat: Map,
) -> None:
    """Whatever the graph was with which it began."""
    flat.observe("ball", "table2")
    flat.add_agent("robot", type="robot", size=(0.4, 0.4, 0.8), pose=(4.5, 2.5, 0, 0))
    live = flat.live_topology()

    def steps(search: SearchPlanner, without: frozenset[str]) -> list[str]:
        with live.snapshot() as seen:
            plan = search.next_steps(seen, "robot", "ball", "found(ball)", without=without)
        return [action.name for action in plan.actions]

    free, left_out = frozenset[str](), frozenset(["door"])
    for order in ((free, left_out), (left_out, free)):
        search = SearchPlanner(live)
        done = {without: steps(search, without) for without in order}
        assert "pass_door" in done[free]
        assert "look" in done[left_out]
        assert "pass_door" not in done[left_out]
