from dataclasses import replace

import pytest
from hypothesis import given, settings

from benchmarks.plans import furnish, tower
from planner.robot_class import RobotClass
from planner.routing_graph import RoutingGraph
from planner.tasks import NoPlanError, TaskObject, TaskState, TaskWorld, find_plan, parse_goal
from planner.tasks.lower_bound import lower_bound
from planner.tasks.problem_builder import build_problem
from semmap.geometry.pose import Pose
from tests.planner.office import office
from tests.planner.tasks.brute import shortest
from tests.planner.tasks.houses import houses
from tests.planner.tasks.validator import validate

FIGURE_4 = """\
pass_door(door1, lab1, corridor1)
pass_door(door2, corridor1, foyer-1st)
call_elevator
pass_door(edoor1, foyer-1st, elevator-1st)
use_elevator(floor-1st, floor-3rd)
pass_door(edoor3, elevator-3rd, foyer-3rd)
pass_door(door5, foyer-3rd, corridor3)
pass_door(door6, corridor3, office4)
pickup(muffin, desk4)
pass_door(door7, office4, corridor3)
pass_door(door8, corridor3, lab2)
place(muffin, desk1)"""


def office_world() -> TaskWorld:
    return TaskWorld(
        [
            TaskObject(
                "desk4",
                ("desk", "table", "furniture"),
                holder="office4",
                place="office4",
                pose=Pose(6.8, 9, 6.4 + 0.37),
                height=0.37,
            ),
            TaskObject(
                "desk1",
                ("desk", "table", "furniture"),
                holder="lab2",
                place="lab2",
                pose=Pose(2, 1, 6.4 + 0.37),
                height=0.37,
            ),
            TaskObject(
                "muffin1",
                ("muffin", "food"),
                holder="desk4",
                place="office4",
                pose=Pose(6.8, 9, 6.4 + 0.8),
                size=(0.1, 0.1, 0.1),
            ),
        ]
    )


def test_figure_4():
    plan = find_plan(RoutingGraph(office()), office_world(), TaskState("lab1"), "on(muffin, desk1)")
    assert "\n".join(map(str, plan.actions)) == FIGURE_4
    assert plan.optimal


@pytest.mark.parametrize(
    ("goal", "reached"),
    [
        ("on(muffin, desk4)", True),
        ("in(muffin, desk4) and in(muffin, office4)", True),
        ("on(muffin, desk4) and in(robot, lab1)", True),
        ("on(muffin, desk4) and in(robot, lab2)", False),
        ("on(muffin, desk4) and carries(robot, muffin)", None),
        ("in(muffin, desk4) and in(muffin, lab2)", None),
        ("on(muffin, desk1)", False),
        ("carries(robot, muffin)", False),
    ],
)
def test_a_goal_is_reached_where_all_of_it_is(goal: str, reached: bool | None) -> None:
    """None: no plan reaches it, as one part of it excludes the other."""
    asked = RoutingGraph(office()), office_world(), TaskState("lab1"), goal
    if reached is None:
        with pytest.raises(ValueError, match=r"."):
            find_plan(*asked)
    else:
        assert (find_plan(*asked).actions == ()) == reached


@settings(max_examples=30)
@given(houses())
def test_plans_are_valid_and_as_short_as_exhaustive_search_finds(house):
    graph = RoutingGraph(house.topology, house.robot)
    goal = parse_goal(house.goal)
    wanted = {str(a.words[0]): str(a.words[1]) for a in goal.atoms if a.relation == "on"}
    end = next((str(a.words[1]) for a in goal.atoms if a.relation == "in"), None)
    cups = [n for n in house.world.objects if n.startswith("cup")]
    best = shortest(
        graph,
        house.world,
        house.state,
        lambda below, held: all(below.get(a) == b for a, b in wanted.items()),
        movable=cups,
        surfaces=[n for n in house.world.objects if n.startswith("table")],
        limits=house.limits,
        end=end,
    )
    try:
        plan = find_plan(graph, house.world, house.state, goal)
    except NoPlanError:
        assert best is None
        return
    validate(plan, house.topology, house.robot, house.world, house.state, goal)
    assert plan.optimal
    assert best is not None
    assert abs(1000 * plan.seconds - best) <= len(plan.actions)  # both round each drive
    problem = build_problem(graph, house.world, house.state, goal)
    assert lower_bound(problem) <= plan.seconds + 1e-6


def test_beyond_what_can_be_proven_in_time_the_gap_is_told():
    topology = tower(100)
    world = furnish(topology, 60)
    goal = " and ".join(f"on(item{i}, table{i + 2})" for i in range(1, 10))
    state = TaskState("room0-5-2")
    plan = find_plan(RoutingGraph(topology), world, state, goal, patience=2.0)
    assert 0.5 * plan.seconds < plan.bound <= plan.seconds
    assert plan.gap < 1.0
    validate(plan, topology, RobotClass(), world, state, parse_goal(goal))


def test_of_several_muffins_the_best_is_taken():
    topology = tower(100)
    world = furnish(topology, 120)
    state = TaskState("room0-5-2")
    graph = RoutingGraph(topology)
    every = [
        find_plan(graph, world, state, f"on({t.name}, table7)").seconds
        for t in world.objects.values()
        if "kind3" in t.types
    ]
    assert len(every) > 3
    best = find_plan(graph, world, state, "on(a kind3, table7)")
    assert best.seconds == pytest.approx(min(every))
    validate(best, topology, RobotClass(), world, state, parse_goal("on(a kind3, table7)"))


@pytest.mark.parametrize(
    ("side", "moved"), [(0.45, {"muffin1", "muffin2"}), (0.15, {"muffin1", "cup"})]
)
def test_a_target_that_could_be_lifted_holds_as_much_as_its_surface_has_room_for(side, moved):
    """On a chest there is room for three things; from a book, what is there is taken off first."""
    world = office_world()
    things = [*world.objects.values()]
    muffin = world.objects["muffin1"]
    surface = side * side - 0.01  # that the cup leaves free
    things += [
        replace(muffin, name="muffin2", pose=Pose(7.0, 9, 7.2)),
        TaskObject(
            "chest",
            ("container",),
            holder="desk1",
            place="lab2",
            pose=Pose(2, 1, 7.2),
            size=(side, side, 0.2),
            surface=surface,
        ),
        TaskObject(
            "cup",
            ("cup",),
            holder="chest",
            place="lab2",
            pose=Pose(2, 1, 7.4),
            size=(0.1, 0.1, 0.1),
        ),
    ]
    world, state = TaskWorld(things), TaskState("lab1")
    topology = office()
    goal = "on(muffin1, chest)" + (" and on(muffin2, chest)" if "muffin2" in moved else "")
    plan = find_plan(RoutingGraph(topology), world, state, goal)
    assert {a.names[0] for a in plan.actions if a.name == "pickup"} == moved
    validate(plan, topology, RobotClass(), world, state, parse_goal(goal))
