"""Searches in the office: what they say, what a simulated robot finds, and what it stores."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from planner.live_topology import LiveTopology
from planner.mission import Runner
from planner.mission.runner import MissionEvent
from planner.readers.robot_class import delete_robot_class, store_robot_class
from planner.robot_class import RobotClass
from planner.search import search_mission
from planner.search.line_of_sight import LineOfSight, line_of_sight
from planner.search.problem_builder import Detector, MapSearch, build_search
from planner.search.reader import read_sight
from planner.search.receding_horizon import decide
from planner.search.search_mission import NotFoundError, SearchPlanner
from planner.search.search_problem import as_pomdp
from planner.search.sim_search import find_spots, searching_robot
from planner.search.task_search import SearchingPlanner
from planner.search.trials import compare, summary
from planner.search.viewpoints import Sight
from planner.task_planner import TaskPlanner
from semmap.api.map_results import ObjectSearch
from semmap.geometry.mesh import box_mesh
from semmap.query.map_handle import MapHandle
from tests.command_line import semmap
from tests.oracles.point_based import solve
from tests.planner.mission.conftest import SPEED, World, mission_url, world
from tests.planner.search.problems import random_search

__all__ = ["mission_url", "world"]

SURE = Detector(hit=0.99, false_alarm=0.001)


@pytest.fixture
def clean(world: World) -> Iterator[World]:
    """The office without observations."""
    world.ask("DELETE FROM observation RETURNING 1")
    yield world
    world.ask("DELETE FROM observation RETURNING 1")


_BUILT: dict[object, MapSearch] = {}


@pytest.fixture(autouse=True)
def build_once(monkeypatch):
    """The same search, of the same belief from the same place, is built once for all tests."""

    def build(name, belief, places, occluders, graph, start, **more):
        key = name, tuple(belief.items()), start.place, start.pose, repr(more["detector"])
        if key not in _BUILT:
            _BUILT[key] = build_search(name, belief, places, occluders, graph, start, **more)
        return _BUILT[key]

    monkeypatch.setattr(search_mission, "build_search", build)


class Died(Exception):
    pass


def search(
    world, goal="found(muffin1)", put=(), detector=SURE, mission=None, on_event=None, **more
):
    """The result of a mission, its answers, and its number."""
    said: list[str] = []
    live = LiveTopology(MapHandle(world.engine, "office"))
    with world.store() as store:
        for spot in find_spots(store, live, put):
            world.world.put_object(*spot)
        planner = SearchPlanner(live, Sight(), detector, said.append)
        body = searching_robot(
            live, world.world, "robot", ["muffin1"], Sight(), detector, speed=SPEED, **more
        )
        runner = Runner(
            store,
            body,
            SearchingPlanner(TaskPlanner(live), planner),
            speed=SPEED,
            tick=0.0,
            on_event=on_event,
        )
        number = store.add("robot", goal) if mission is None else mission
        return runner.run(number), planner.answers, said


def test_a_moved_muffin_is_found_and_what_was_seen_is_stored(clean):
    result, answers, said = search(clean, put=["muffin1 on coffee_table3"])
    assert result.state == "done"
    answer = answers["muffin1"]
    assert (answer.found, answer.place, answer.seen) == (True, "coffee_table3", True)
    assert answer.probability >= answer.sure == pytest.approx(0.95)
    assert answer.looks >= 2
    assert clean.holder("muffin1") == ("coffee_table3", "on")
    rows = clean.ask(
        "SELECT p.name, o.seen, o.visible FROM observation o JOIN entity p ON p.id = o.place_id "
        "WHERE o.entity_id = entity_id('muffin1') AND o.observer_id = entity_id('robot')"
    )
    seen = {name for name, found, _ in rows if found}
    assert seen == {"coffee_table3"}
    assert ("desk4", False) in {(name, found) for name, found, _ in rows}  # where the map had it
    assert all(0 < share <= 1 for _, _, share in rows)
    steps = clean.ask("SELECT action, state FROM mission_step ORDER BY number")
    assert [s for a, s in steps if a == "look"] == ["done"] * answer.looks
    assert "desk4" in said[0]
    assert "seen there): another look, from " in said[-1]
    best = clean.ask("SELECT place FROM where_is('muffin1') LIMIT 1")
    assert best == [("coffee_table3",)]


def test_a_search_continues_after_its_process_has_died(clean):
    def die(event: MissionEvent) -> None:
        if event.kind == "acted" and event.command.behaviour == "look":
            raise Died

    with pytest.raises(Died):
        search(clean, on_event=die)
    (number,) = clean.ask("SELECT id FROM mission")[0]
    result, answers, _ = search(clean, mission=number)
    assert result.state == "done"
    assert answers["muffin1"].place == "desk4"
    steps = clean.ask("SELECT action, state, cause FROM mission_step ORDER BY number")
    first = next(step for step in steps if step.action == "look")
    assert (first.state, first.cause) == ("failed", "interrupted")


def test_what_is_searched_for_is_then_fetched(clean):
    clean.ask(
        "INSERT INTO observation (entity_id, place_id, seen) "  # missed, so that it is doubtful
        "VALUES (entity_id('muffin1'), entity_id('desk4'), false) RETURNING 1"
    )
    result, _, _ = search(clean, "on(muffin1, desk1)", ["muffin1 on coffee_table3"])
    assert result.state == "done"
    actions = [name for (name,) in clean.ask("SELECT action FROM mission_step ORDER BY number")]
    assert actions.index("look") < actions.index("pickup")
    assert clean.holder("muffin1") == ("desk1", "on")
    assert clean.world.objects()["muffin1"][1].holder == "desk1"


def test_an_object_that_is_nowhere_ends_the_mission_with_a_reason(clean):
    with clean.world.change() as file:
        file.execute("DELETE FROM thing WHERE name = 'muffin1'")
    result, answers, _ = search(clean, detector=Detector(0.99, 0.001, missed=400.0))
    assert result.state == "failed"
    answer = answers["muffin1"]
    assert result.reason == answer.reason
    assert "was not found in" in answer.reason
    assert "No look is worth its time" in answer.reason
    assert not answer.found
    assert len(answer.looked_at) > 1
    assert 0.5 < answer.covered < 1
    assert issubclass(NotFoundError, ValueError)


def test_a_search_ends_when_its_time_is_over(clean):
    with clean.world.change() as file:
        file.execute("DELETE FROM thing WHERE name = 'muffin1'")
    result, answers, _ = search(clean, detector=Detector(0.99, 0.001, limit=5.0))
    assert result.state == "failed"
    assert "The time of the search is over (5 s)" in result.reason
    assert answers["muffin1"].looks == 1


def test_a_search_that_begins_again_keeps_its_looks_and_its_time(clean):
    """Desk 4, where the map has the muffin, has another name after the first look."""
    with clean.world.change() as file:
        file.execute("DELETE FROM thing WHERE name = 'muffin1'")
    rename = (
        "UPDATE entity SET name = :new WHERE map_id = current_map() AND name = :old RETURNING 1"
    )
    done = []

    def change(event: MissionEvent) -> None:
        if event.kind == "ended":
            done.append(event.command)
            looks = [step for step in done if step.behaviour == "look"]
            if looks == [event.command]:
                assert clean.ask(rename, old="desk4", new="bench")

    detector = Detector(0.99, 0.001, limit=60.0)
    try:
        result, answers, _ = search(clean, detector=detector, on_event=change)
    finally:
        clean.ask(rename, old="bench", new="desk4")
    looks = [step for step in done if step.behaviour == "look"]
    assert result.state == "failed"
    assert answers["muffin1"].looks == len(looks) > 1
    assert "bench" in answers["muffin1"].looked_at
    before = done[: done.index(looks[-2]) + 1]  # the last plan begins before the time is over
    assert sum(step.seconds for step in before) < 60 <= sum(step.seconds for step in done)


SEEN = """
INSERT INTO observation (entity_id, place_id, seen, hit, false_alarm)
VALUES (entity_id('muffin1'), entity_id('coffee_table3'), true, 0.99, 0.001) RETURNING id
"""
MOVED = """
UPDATE placement SET pose[1] = pose[1] + :metres WHERE entity_id = entity_id('desk2') RETURNING 1
"""


STEPS = {"furniture moved": 0.5, "a little": 0.05}  # metres


@pytest.mark.parametrize(
    "what", ["seen by another", "furniture moved", "missed by another", "a little"]
)
def test_a_search_is_planned_again_when_others_know_more_or_furniture_moves(
    clean, what, monkeypatch
):
    begun = []
    original = SearchPlanner.begin

    def begin(self, seen, name, start, progress=None):
        begun.append(len(looked))
        return original(self, seen, name, start, progress)

    monkeypatch.setattr(SearchPlanner, "begin", begin)
    looked = []

    def change(event: MissionEvent) -> None:
        if event.kind == "ended" and event.command.behaviour == "look":
            looked.append(event.command.arguments)
            if len(looked) == 1 and what == "seen by another":
                clean.ask(SEEN)
            if len(looked) == 1 and what == "missed by another":
                clean.ask(SEEN.replace("true", "false"))
            if len(looked) == 1 and what in STEPS:
                clean.ask(MOVED, metres=STEPS[what])

    try:
        result, answers, _ = search(clean, put=["muffin1 on coffee_table3"], on_event=change)
    finally:
        if what in STEPS:
            clean.ask(MOVED, metres=-STEPS[what])
    assert result.state == "done"
    assert answers["muffin1"].place == "coffee_table3"
    assert answers["muffin1"].looks == len(looked)
    assert begun == ([0, 1] if what in ("seen by another", "furniture moved") else [0])
    if what == "seen by another":
        assert "coffee_table3" in looked[1]


def test_a_class_whose_urdf_is_broken_has_an_assumed_camera(clean, tmp_path):
    live = LiveTopology(MapHandle(clean.engine, "office"))
    urdf = tmp_path / "robot.urdf"
    urdf.write_text("<robot>")
    with clean.engine.begin() as connection:
        store_robot_class(connection, RobotClass("blind"), urdf=urdf)
    try:
        for name, why in (
            ("blind", "cannot be read"),
            ("nobody", "not known"),
            (None, "not known"),
        ):
            with live.snapshot() as seen:
                sight, assumed = read_sight(seen, name)
            assert sight == Sight()
            assert why in assumed
    finally:
        with clean.engine.begin() as connection:
            delete_robot_class(connection, "blind")


@pytest.fixture(scope="module")
def office_search(mission_url: str):
    """The search for the muffin in the office, from lab1."""
    from semmap.database import open_engine

    engine = open_engine(mission_url)
    live = LiveTopology(MapHandle(engine, "office"))
    with live.snapshot() as seen:
        found = SearchPlanner(live).begin(seen, "muffin1", live.graph.endpoint("lab1"))
    engine.dispose()
    return found


def test_viewpoints_show_most_of_what_is_believed(office_search):
    problem, belief = office_search.problem, office_search.belief[0]
    in_view = problem.visible.max(axis=0) > 0
    assert belief[in_view].sum() > 0.6
    assert np.isfinite(problem.travel).all()
    desk4 = problem.places.index("desk4")
    best = max(office_search.viewpoints, key=lambda v: dict(v.shows).get("desk4", 0.0))
    assert problem.in_view[office_search.viewpoints.index(best), desk4] == 1
    assert np.hypot(best.pose.x - 8.9, best.pose.y - 1.5) < 4.0
    for number, viewpoint in enumerate(office_search.viewpoints):
        shares = (problem.visible[number] * office_search.share) @ problem.membership
        for place, share in viewpoint.shows:
            assert shares[problem.places.index(place)] == pytest.approx(share)


def test_what_a_search_finds_is_true_and_what_is_remembered_is_found_sooner():
    """Places in turn, one of which no viewpoint shows: not to find the object there is right."""
    problem, belief = random_search(
        4, places=10, viewpoints=10, hit=0.9, false_alarm=0.02, wrong=400_000.0
    )
    visible = problem.visible.copy()
    visible[9] = 0.0
    problem = replace(problem, missed=20_000.0, visible=visible)
    search = MapSearch(problem, belief, (), np.ones(10), None)
    cases = compare(search, 40, seed=1)["cases"]
    for case, rows in cases.items():
        for name, row in rows.items():
            assert row["right"] + row["wrong"] + row["missed"] == pytest.approx(1)
            assert row["seconds"]["low"] < row["seconds"]["mean"] < row["seconds"]["high"]
            assert row["right"] <= rows["remembers"]["right"], (case, name)
        assert rows["remembers"]["right"] >= 0.95, case
        assert rows["remembers"]["wrong"] <= 0.025, case
    for name in ("without memory", "nearest first"):
        assert cases["still there"][name]["slower"]["low"] > 0, name
        assert cases["still there"][name]["slower_if_right"]["low"] > 0, name
    with pytest.raises(ValueError, match="1 trials"):
        compare(search, 1)


def test_what_is_slower_is_also_told_of_searches_that_both_answer_rightly():
    """Seconds, found, wrong and missed: an error that ends a search early is not faster."""
    ours = [[(10, 1, 0, 0), (20, 1, 0, 0)], [(30, 1, 0, 0), (40, 0, 0, 1)], [(5, 0, 0, 0)] * 2]
    theirs = [[(14, 1, 0, 0), (1, 0, 1, 0)], [(36, 1, 0, 0), (1, 1, 0, 0)], [(1, 0, 1, 0)] * 2]
    rows = summary({"remembers": np.array(ours, float), "other": np.array(theirs, float)})
    assert rows["other"]["slower"]["mean"] == pytest.approx(np.mean([-7.5, -16.5, -4]))
    assert rows["other"]["slower_if_right"]["mean"] == pytest.approx(np.mean([4, 6]))
    last = {"remembers": np.array(ours[2:], float), "other": np.array(theirs[2:], float)}
    assert summary(last)["other"]["slower_if_right"] is None


def test_trials_end_after_the_limit_of_the_detector():
    """With 1 s there is one look, from the viewpoint that the strategy chooses."""
    problem, belief = random_search(0, false_alarm=0.02, wrong=400_000.0)
    search = MapSearch(replace(problem, missed=20_000.0), belief, (), np.ones(3), None)
    options = {"detector": Detector(limit=1.0)}
    found = ObjectSearch("mug", {}, search, decide(problem, belief), None, options).compare(4)
    once = problem.start.max() + problem.look
    for rows in found["cases"].values():
        for name, row in rows.items():
            assert row["seconds"]["mean"] <= once + 1e-9, name


def test_a_wall_hides_what_is_behind_it():
    wall = box_mesh((1.0, -2.0, 0.0), (1.1, 2.0, 2.0)).triangles
    space = LineOfSight(wall)
    points = np.array([[0.5, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 0.0, 3.5], [2.0, 5.0, 1.0]])
    assert space.sees(np.array([0.0, 0.0, 1.5]), points).tolist() == [True, False, True, True]
    assert not space.is_free(np.array([1.0, 0.0, 1.0]))


def test_the_latest_space_is_kept_while_the_obstacles_are_the_same():
    wall = box_mesh((1.0, -2.0, 0.0), (1.1, 2.0, 2.0)).triangles
    before = line_of_sight(wall)
    assert line_of_sight(wall.copy()) is before
    assert line_of_sight(wall + 0.5).is_free(np.array([1.0, 0.0, 1.0]))
    assert not line_of_sight(wall).is_free(np.array([1.0, 0.0, 1.0]))


def test_the_command_says_where_to_look_and_why(clean):
    found = json.loads(semmap(clean.url, "search", "muffin1", "--from", "lab1", "--json").stdout)
    assert found["action"] == "go"
    assert sum(found["belief"].values()) == pytest.approx(1)
    assert max(found["belief"], key=found["belief"].get) == "desk4"
    assert "desk4" in found["tour"][0]["shows"]


def test_the_command_fails_where_the_object_is_not_found(clean, tmp_path):
    words = ("--from", "lab1", "--simulate", "--speed", 100000, "--limit", 1)
    words += ("--put", "muffin1 on coffee_table3", "--world", tmp_path / "world.sqlite")
    result = semmap(clean.url, "search", "muffin1", *words, "--json")
    assert result.exit_code == 1
    told = json.loads(result.stdout)
    assert told["state"] == "failed"
    assert "found" not in told
    muffin = told["not_found"]["muffin1"]
    assert told["reason"] == muffin["reason"]
    assert "The time of the search is over (1 s)" in muffin["reason"]
    assert muffin["probability"] < muffin["sure"]
    assert muffin["looked_at"]


def test_a_plan_says_that_it_searches_first(clean):
    clean.ask(
        "INSERT INTO observation (entity_id, place_id, seen) "  # missed, so that it is doubtful
        "VALUES (entity_id('muffin1'), entity_id('desk4'), false) RETURNING 1"
    )
    plan = json.loads(
        semmap(clean.url, "plan", "on(muffin1, desk1)", "--from", "lab1", "--json").stdout
    )
    names = [action["name"] for action in plan["actions"]]
    assert names[0] == "search"
    assert plan["actions"][0]["arguments"][0] == "muffin1"
    assert names[-1] == "place"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--hit", "1.5"), "hit is 1.5"),
        (("--false-alarm", "0.95"), "must be seen more often"),
        (("--missed", "-1"), "missed is -1"),
        (("--sure", "1"), "sure is 1"),
        (("--limit", "0"), "limit is 0"),
        (("--range", "0"), "camera sees from"),
    ],
)
def test_bad_rates_are_refused(clean, options, message):
    result = semmap(clean.url, "search", "muffin1", "--from", "lab1", *options)
    assert result.exit_code != 0
    assert message in " ".join(result.output.split())


def test_an_unknown_object_is_refused(clean):
    with pytest.raises(LookupError, match="mufin"):
        semmap(clean.url, "search", "mufin", "--from", "lab1")


def test_a_small_search_of_the_map_is_solved_as_a_pomdp(office_search):
    problem = office_search.problem
    from planner.search.search_problem import SearchProblem

    few = [0, 1, 2]
    spots = np.flatnonzero(problem.visible[few].any(axis=0))[:6]
    places = np.unique(problem.place_of[spots])
    small = SearchProblem(
        problem.objects,
        tuple(problem.places[p] for p in places),
        tuple(problem.viewpoints[v] for v in few),
        np.searchsorted(places, problem.place_of[spots]),
        problem.visible[np.ix_(few, spots)],
        problem.travel[np.ix_(few, few)],
        problem.start[few],
        problem.look,
        problem.hit,
        problem.false_alarm,
        problem.wrong,
        problem.opening[few],
    )
    belief = np.full((1, len(spots)), 1 / len(spots))
    pomdp = as_pomdp(small, belief)
    assert solve(pomdp).value(pomdp.start) > -small.declared(belief)[1]
