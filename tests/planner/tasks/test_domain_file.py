from pathlib import Path

import pytest

from planner.routing_graph import RoutingGraph
from planner.tasks import NoPlanError, TaskObject, TaskState, TaskWorld, find_plan, parse_goal
from planner.tasks.domain_file import DomainError, read_domain
from planner.tasks.problem_builder import build_problem
from semmap.geometry.pose import Pose
from tests.planner.office import office
from tests.planner.tasks.test_pddl import solved

TIDY = Path(__file__).parents[3] / "examples" / "office" / "tidy.yaml"


def garden(**plant: object) -> TaskWorld:
    fixed = {"graspable": False, "height": 0.4}
    return TaskWorld(
        [
            TaskObject(
                "plant1",
                ("potted_plant",),
                None,
                "lab1",
                "lab1",
                Pose(4, 1, 0.4),
                **fixed,
                properties=plant,
            ),
            TaskObject("sink1", ("sink",), None, "lab1", "lab1", Pose(6, 2, 0.4), **fixed),
            TaskObject("desk1", ("table",), None, "lab1", "lab1", Pose(1, 1, 0.4), **fixed),
            TaskObject("cup1", ("cup",), None, "desk1", "lab1", Pose(1, 1, 0.8)),
            TaskObject("cup2", ("cup",), None, "desk1", "lab1", Pose(1, 1.4, 0.8)),
        ]
    )


def test_a_plant_is_watered_with_a_cup_that_is_filled_first(tmp_path):
    graph, domain = RoutingGraph(office()), read_domain(TIDY)
    world, state = garden(), TaskState("lab1", Pose(1, 2, 0))
    plan = find_plan(graph, world, state, "watered(a potted_plant)", domain=domain)
    assert [str(a) for a in plan.actions] == [
        "pickup(cup2, desk1)",
        "fill(cup2, sink1)",
        "water(potted_plant, cup2)",
        "place(cup2, desk1)",
    ]
    assert plan.actions[2].names == ("plant1", "cup2")
    assert plan.optimal
    goal = parse_goal("watered(a potted_plant)", domain.relations)
    problem = build_problem(graph, world, state, goal, domain=domain)
    assert solved(problem, tmp_path) == pytest.approx(1000 * plan.seconds, abs=4)


def test_what_is_so_by_now_takes_nothing():
    plan = find_plan(
        RoutingGraph(office()),
        garden(watered=True),
        TaskState("lab1"),
        "watered(plant1)",
        domain=read_domain(TIDY),
    )
    assert plan.actions == ()


def test_what_no_action_brings_about_is_said():
    with pytest.raises(NoPlanError, match=r"achieves watered\(desk1\)"):
        find_plan(
            RoutingGraph(office()),
            garden(),
            TaskState("lab1"),
            "watered(desk1)",
            domain=read_domain(TIDY),
        )


def test_facts_that_need_each_other_in_many_ways_end(tmp_path):
    of = "parameters: {p: potted_plant}"
    actions = "".join(
        f"  {name}{i}: {{{of}, needs: [f{i - 1}(p)], effects: [f{i}(p)]}}\n"
        for i in range(1, 60)
        for name in "ab"
    )
    path = tmp_path / "many.yaml"
    path.write_text(f"actions:\n{actions}")
    with pytest.raises(NoPlanError, match="in more than 10000 ways"):
        find_plan(
            RoutingGraph(office()),
            garden(),
            TaskState("lab1"),
            "f59(plant1)",
            domain=read_domain(path),
        )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("actions:\n  water:\n    efects: [a(b)]\n", "line 3: water: unknown key efects"),
        ("actions:\n  water:\n    parameters: {p: plant}\n", "line 2: water has no effects"),
        (
            "actions:\n  w:\n    parameters: {p: plant}\n    effects: [wet(q)]\n",
            "line 4: w: wet uses q, which is not a parameter; there are: p",
        ),
        ("actions:\n  w:\n    effects: [on(a, b)]\n", "line 3: w: on uses a, which is not"),
        (
            "actions:\n  w:\n    parameters: {p: plant, q: table}\n    effects: [on(p, q)]\n",
            "line 4: w: on is defined by the planner",
        ),
        (
            "actions:\n  w:\n    parameters: {p: plant}\n    at: r\n    effects: [wet(p)]\n",
            "line 4: w: at is a parameter, not r",
        ),
        ("actions:\n  w:\n    effects: [wet]\n", "line 3: w: a fact reads"),
        ("actions:\n  w:\n    effects: [wet()]\n    seconds: soon\n", "line 4: w: seconds: give a"),
        ("actions: [", "line 1: invalid YAML"),
        ("actions: " + "[" * 5000, "line 1: nests 65 levels, the limit is 64 levels"),
        ("actions:\n  a: &a {needs: *a}\n", "line 2: has an alias .a that contains itself"),
        (
            "actions:\n" + "".join(f"  a{i}: {{effects: [f{i}()]}}\n" for i in range(201)),
            "line 1: has 201 actions, the limit is 200 actions",
        ),
        ("- a", "line 1: the file begins with actions:"),
        ("", "line 1: the file begins with actions:"),
        ("actions:\n  pickup:\n    effects: [wet()]\n", "line 2: an action cannot be named pickup"),
        (
            "actions:\n  a: {effects: [wet()]}\n  a: {effects: [wet()]}\n",
            "line 3: a is there twice",
        ),
        (
            "actions:\n  a: {parameters: {p: x}, effects: [wet(p)]}\n  b: {effects: [wet()]}\n",
            "line 3: b: wet is of 0 objects here, of 1 before",
        ),
    ],
)
def test_mistakes_are_named_with_their_line(tmp_path, text, message):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(DomainError, match=message.replace("(", r"\(").replace(")", r"\)")):
        read_domain(path)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(DomainError, match="name a YAML file"):
        read_domain(tmp_path / "none.yaml")
