"""What bars a task is said in words."""

from dataclasses import replace

import pytest

from planner.robot_class import RobotClass
from planner.tasks import GoalError, NoPlanError, State, Thing, World, parse_goal, plan_task
from planner.tasks.validator import InvalidPlanError, validate
from planner.tasks.world import UnknownThingError
from semmap.geometry.pose import Pose
from tests.planner.office import office
from tests.planner.tasks.test_plan import office_world


def world(**changed: dict[str, object]) -> World:
    things = office_world().things
    return World([replace(t, **changed.get(n, {})) for n, t in things.items()])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("goal", "changed", "doors", "kind", "message"),
    [
        ("on(muffin, desk1)", {}, {"door8": {"state": "locked"}}, NoPlanError,
         "^desk1 cannot be reached: door8 is locked$"),
        ("on(mufin, desk1)", {}, {}, UnknownThingError, "no mufin is known.*did you mean muffin"),
        ("on(muffin, desk1)", {"muffin1": {"height": 1.9}}, {}, NoPlanError,
         "muffin1 is 1.9 m high, the robot reaches 1.6 m"),
        ("on(muffin, desk1)", {"muffin1": {"weight": 20.0}}, {}, NoPlanError, "weighs 20 kg"),
        ("on(muffin, desk1)", {"muffin1": {"graspable": False}}, {}, NoPlanError, "not graspable"),
        ("on(desk4, desk1)", {}, {}, NoPlanError, "desk4 is fixed"),
        ("on(muffin, desk1)", {"desk1": {"surface": 0.0}}, {}, NoPlanError, "no level surface"),
        ("on(muffin, desk1)", {"desk1": {"surface": 0.001}}, {}, NoPlanError, "desk1 is full"),
        ("on(muffin, desk1)", {"desk1": {"surface_height": 1.9}}, {}, NoPlanError,
         "desk1 is 1.9 m high, the robot reaches 1.6 m"),
        ("on(muffin, lab2)", {}, {}, GoalError, r"lab2 is a place; say in\(muffin, lab2\)"),
        ("on(muffin, desk1) and on(muffin1, desk4)", {}, {}, GoalError, "are the same thing"),
        ("on(muffin, desk1) and on(another muffin, desk1)", {}, {}, NoPlanError, "asks for 2 of"),
        ("in(robot, lab2)", {}, {"door8": {"state": "locked"}}, NoPlanError, "door8 is locked"),
    ],
)  # fmt: skip
def test_reasons(goal, changed, doors, kind, message):
    with pytest.raises(kind, match=message):
        plan_task(office(**doors).network(), world(**changed), State("lab1"), goal)


def test_more_in_hand_than_it_carries_is_refused():
    things = [*office_world().things.values(), Thing("cup1"), Thing("cup2")]
    with pytest.raises(NoPlanError, match="already carries cup1, cup2"):
        plan_task(office().network(), World(things), State("lab1", None, ("cup1", "cup2")),
                  "on(muffin, desk1)")  # fmt: skip


def test_what_is_in_hand_is_put_down_first():
    things = [*office_world().things.values(), Thing("cup1", ("cup",))]
    state = State("lab1", None, ("cup1",))
    plan = plan_task(office().network(), World(things), state, "on(muffin, desk1)")
    assert [str(a) for a in plan.actions if a.name in ("pickup", "place")] == [
        "place(cup1, desk4)", "pickup(muffin, desk4)", "place(muffin, desk1)",
    ]  # fmt: skip
    validate(plan, office(), RobotClass(), World(things), state, parse_goal("on(muffin, desk1)"))


def test_a_tray_is_carried_with_what_stands_on_it():
    tray = Thing(
        "tray1", ("tray",), None, "desk4", "office4", Pose(6, 9, 7.2), size=(0.4, 0.3, 0.02)
    )
    cup = Thing("cup1", ("cup",), None, "tray1", "office4", Pose(6, 9, 7.2), size=(0.1, 0.1, 0.1))
    there = World([*office_world().things.values(), tray, cup])
    goal = "on(tray1, desk1) and in(cup1, lab2) and on(muffin, tray1)"
    plan = plan_task(office().network(), there, State("lab1"), goal)
    assert [str(a) for a in plan.actions if a.name in ("pickup", "place")] == [
        "pickup(muffin, desk4)", "place(muffin, tray1)", "pickup(tray1, desk4)",
        "place(tray1, desk1)",
    ]  # fmt: skip
    validate(plan, office(), RobotClass(), there, State("lab1"), parse_goal(goal))


def test_the_validator_finds_what_is_wrong():
    network, goal = office().network(), parse_goal("on(muffin, desk1)")
    plan = plan_task(network, office_world(), State("lab1"), goal)

    def check(plan, topology=office(), world_=office_world(), said=goal):  # noqa: B008
        validate(plan, topology, RobotClass(), world_, State("lab1"), said)

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
            plan, world_=World([*office_world().things.values(), Thing("cup1", holder="muffin1")])
        )
    with pytest.raises(InvalidPlanError, match="does not reach"):
        check(plan, said=parse_goal("on(muffin, desk4)"))
