"""What bars a task is said in words."""

from dataclasses import replace

import pytest

from planner.robot_class import RobotClass
from planner.routing_graph import RoutingGraph
from planner.tasks import (
    GoalError,
    NoPlanError,
    TaskObject,
    TaskState,
    TaskWorld,
    find_plan,
    parse_goal,
)
from planner.tasks.world import UnknownObjectError
from planner.topology import Place, PlaceConnector, Topology
from semmap.geometry.pose import Pose
from tests.planner.office import office
from tests.planner.tasks.test_solver import office_world
from tests.planner.tasks.validator import InvalidPlanError, validate


def world(**changed: dict[str, object]) -> TaskWorld:
    items = office_world().objects
    return TaskWorld([replace(t, **changed.get(n, {})) for n, t in items.items()])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("goal", "changed", "doors", "kind", "message"),
    [
        (
            "on(muffin, desk1)",
            {},
            {"door8": {"state": "locked"}},
            NoPlanError,
            "^desk1 cannot be reached: door8 is locked$",
        ),
        (  # the desk stands in a doorway, and what is on it on the other side
            "in(muffin, lab2)",
            {
                "muffin1": {"holder": "desk1", "place": "lab1"},
                "desk1": {"surface": 1.0, "surface_height": 0.7},
            },
            {"door8": {"state": "locked"}},
            NoPlanError,
            "^desk1 cannot be reached: door8 is locked$",
        ),
        ("on(mufin, desk1)", {}, {}, UnknownObjectError, "there is no mufin.*did you mean muffin"),
        (
            "on(muffin, desk1)",
            {"muffin1": {"height": 1.9}},
            {},
            NoPlanError,
            "muffin1 is 1.9 m high, the robot reaches 1.6 m",
        ),
        ("on(muffin, desk1)", {"muffin1": {"weight": 20.0}}, {}, NoPlanError, "weighs 20 kg"),
        ("on(muffin, desk1)", {"muffin1": {"graspable": False}}, {}, NoPlanError, "not graspable"),
        ("on(desk4, desk1)", {}, {}, NoPlanError, "desk4 is a desk; a robot does not carry it"),
        ("on(muffin, desk1)", {"desk1": {"surface": 0.0}}, {}, NoPlanError, "no level surface"),
        ("on(muffin, desk1)", {"desk1": {"surface": 0.001}}, {}, NoPlanError, "desk1 is full"),
        (
            "on(muffin, desk1)",
            {"desk1": {"surface_height": 1.9}},
            {},
            NoPlanError,
            "desk1 is 1.9 m high, the robot reaches 1.6 m",
        ),
        ("on(muffin, lab2)", {}, {}, GoalError, r"lab2 is a place; say in\(muffin, lab2\)"),
        ("on(muffin, desk1) and on(muffin1, desk4)", {}, {}, GoalError, "are the same object"),
        ("on(muffin, desk1) and on(another muffin, desk1)", {}, {}, NoPlanError, "needs 2 of"),
        ("in(robot, lab2)", {}, {"door8": {"state": "locked"}}, NoPlanError, "door8 is locked"),
    ],
)
def test_reasons(goal, changed, doors, kind, message):
    with pytest.raises(kind, match=message):
        find_plan(RoutingGraph(office(**doors)), world(**changed), TaskState("lab1"), goal)


def test_more_in_hand_than_it_carries_is_refused():
    items = [*office_world().objects.values(), TaskObject("cup1"), TaskObject("cup2")]
    with pytest.raises(NoPlanError, match="already carries cup1, cup2"):
        find_plan(
            RoutingGraph(office()),
            TaskWorld(items),
            TaskState("lab1", None, ("cup1", "cup2")),
            "on(muffin, desk1)",
        )


def test_what_is_in_hand_is_put_down_first():
    items = [*office_world().objects.values(), TaskObject("cup1", ("cup",))]
    state = TaskState("lab1", None, ("cup1",))
    plan = find_plan(RoutingGraph(office()), TaskWorld(items), state, "on(muffin, desk1)")
    assert [str(a) for a in plan.actions if a.name in ("pickup", "place")] == [
        "place(cup1, desk4)",
        "pickup(muffin, desk4)",
        "place(muffin, desk1)",
    ]
    validate(plan, office(), RobotClass(), TaskWorld(items), state, parse_goal("on(muffin, desk1)"))


def test_a_tray_is_carried_with_what_stands_on_it():
    tray = TaskObject(
        "tray1", ("tray",), None, "desk4", "office4", Pose(6, 9, 7.2), size=(0.4, 0.3, 0.02)
    )
    cup = TaskObject(
        "cup1", ("cup",), None, "tray1", "office4", Pose(6, 9, 7.2), size=(0.1, 0.1, 0.1)
    )
    there = TaskWorld([*office_world().objects.values(), tray, cup])
    goal = "on(tray1, desk1) and in(cup1, lab2) and on(muffin, tray1)"
    plan = find_plan(RoutingGraph(office()), there, TaskState("lab1"), goal)
    assert [str(a) for a in plan.actions if a.name in ("pickup", "place")] == [
        "pickup(muffin, desk4)",
        "place(muffin, tray1)",
        "pickup(tray1, desk4)",
        "place(tray1, desk1)",
    ]
    validate(plan, office(), RobotClass(), there, TaskState("lab1"), parse_goal(goal))


def test_the_validator_finds_what_is_wrong():
    graph, goal = RoutingGraph(office()), parse_goal("on(muffin, desk1)")
    plan = find_plan(graph, office_world(), TaskState("lab1"), goal)

    def check(plan, topology=office(), world_=office_world(), said=goal):  # noqa: B008
        validate(plan, topology, RobotClass(), world_, TaskState("lab1"), said)

    check(plan)
    for i in range(len(plan.actions)):
        missing = replace(plan, actions=plan.actions[:i] + plan.actions[i + 1 :])
        with pytest.raises(InvalidPlanError):
            check(missing)
    with pytest.raises(InvalidPlanError, match="it takes"):
        check(replace(plan, seconds=plan.seconds - 1))
    with pytest.raises(InvalidPlanError, match="door6 is locked"):
        check(plan, office(door6={"state": "locked"}))
    with pytest.raises(InvalidPlanError, match="cup1 stands on muffin1"):
        check(
            plan,
            world_=TaskWorld(
                [*office_world().objects.values(), TaskObject("cup1", holder="muffin1")]
            ),
        )
    with pytest.raises(InvalidPlanError, match="does not reach"):
        check(plan, said=parse_goal("on(muffin, desk4)"))


@pytest.mark.parametrize(
    ("name", "type_", "holder", "bottom", "top", "hangs"),
    [
        ("PortraitA_01", "picture", "bedroom", 1.00, 1.69, True),
        ("PortraitB_01", "picture", "living-room", 0.00, 0.69, False),  # leans at a wall
        ("DeskPortraitC_01", "picture", "NightStand_01_001", 0.69, 0.86, False),
        ("Chandelier_01_003", "ceiling_lamp", "kitchen", 1.74, 2.66, True),
        ("Vase_01", "vase", "kitchen", 1.00, 1.20, False),
    ],
)
def test_what_hangs_in_small_house_is_not_carried(name, type_, holder, bottom, top, hangs):
    room = holder if holder in ("bedroom", "living-room", "kitchen") else "bedroom"
    size = (0.3, 0.05, top - bottom)
    thing = TaskObject(
        name, (type_,), holder=holder, place=room, height=(bottom + top) / 2, size=size
    )
    why = thing.obstacle((0.0, 3.0))
    assert (why == f"{name} hangs; a robot does not take it down") == hangs, why


def test_ways_that_lead_there_but_not_on_are_named():
    poses = (Pose(-0.5), Pose(0.5))
    doors = [
        PlaceConnector("door1", ("a", "b"), poses, direction="forward"),
        PlaceConnector("door2", ("a", "c"), poses),
    ]
    graph = RoutingGraph(Topology.of([Place("a"), Place("b"), Place("c")], doors))
    at = {"pose": Pose(z=0.8), "size": (0.1, 0.1, 0.1)}
    items = [
        TaskObject("cup", ("cup",), None, "b", "b", **at),
        TaskObject("bowl", ("bowl",), None, "c", "c", **at),
        TaskObject("table1", ("table", "furniture"), None, "b", "b", **at),
        TaskObject("table2", ("table", "furniture"), None, "c", "c", **at),
    ]
    why = "from b to (c|a): door1 leads only from a to b"
    for goal in (
        "on(cup, table2)",
        "on(bowl, table1) and in(robot, a)",
        "on(bowl, table1) and in(cup, c)",
    ):
        with pytest.raises(NoPlanError, match=why):
            find_plan(graph, TaskWorld(items), TaskState("a"), goal)
