"""Two robots never hold the same object; one that died lets go of it in time."""

from __future__ import annotations

import os
import threading
import time
from typing import Any

import pytest

from planner.mission import Runner
from planner.mission.claims import claims_of
from planner.mission.command import commands_of
from planner.mission.retry_policy import RetryPolicy
from planner.mission.sim_robot import SimulatedRobot
from planner.mission.sim_world import SimWorld
from planner.plan import Action, Plan
from planner.topology import Topology
from semmap.geometry.pose import Pose
from tests.planner.mission.conftest import SPEED, World
from tests.planner.mission.runs import run_and_die
from tests.planner.mission.simple import simple_planner
from tests.planner.office import office, route

ROUNDS = 1000 if "SEMMAP_SOAK" in os.environ else 15
UPSTAIRS = Pose.planar(1.0, 4.0, 0.0, 7.0)


def claims(topology: Topology, start: str, goal: str, width: float | None = None) -> list[Any]:
    found = route(topology, start, goal)
    actions = tuple(Action(s.behaviour, (), s.seconds, (s,)) for s in found.steps)
    commands = commands_of(Plan("", actions, 0.0, 0.0))
    lifts = {c: lift for lift, cabins in topology.cabins().items() for c in cabins}
    return list(
        zip([s.behaviour for s in commands], claims_of(commands, lifts, width), strict=True)
    )


def test_one_claim_at_a_time_from_the_way_to_it_until_behind_it() -> None:
    assert claims(office(), "lab1", "corridor3") == [
        ("navigate", "door1"),
        ("pass_door", "door1"),
        ("navigate", "door2"),
        ("pass_door", "door2"),
        ("navigate", "elevator"),
        ("call_elevator", "elevator"),
        ("pass_door", "elevator"),
        ("use_elevator", "elevator"),
        ("switch_map", "elevator"),
        ("pass_door", "elevator"),
        ("navigate", "door5"),
        ("pass_door", "door5"),
    ]


def test_two_fit_through_a_wide_door() -> None:
    wide = office(door1={"width": 3.0}, door2={"width": 1.0})
    assert dict.fromkeys(c for _, c in claims(wide, "lab1", "foyer-1st", 0.6)) == dict.fromkeys(
        [None, "door2"]
    )


def test_two_never_hold_it_at_once(world: World) -> None:
    world.add_robot("other", "lab1", Pose.planar(14.0, 2.5))
    inside: list[str] = []
    most: list[int] = []
    lock = threading.Lock()

    def claim_and_release(robot: str) -> None:
        with world.store(robot) as store:
            mission = store.add(robot, "x")
            store.take(mission)
            got = 0
            while got < 100:
                if store.claim(mission, ["elevator"], 5.0) is not None:
                    continue
                with lock:
                    inside.append(robot)
                    most.append(len(inside))
                time.sleep(0.0002)
                with lock:
                    inside.remove(robot)
                store.release(mission, ["elevator"])
                got += 1

    together([lambda r=r: claim_and_release(r) for r in ("robot", "other")])
    assert len(most) == 200
    assert max(most) == 1


def test_a_claim_expires_unless_it_is_renewed(world: World) -> None:
    world.add_robot("other", "lab1", Pose.planar(14.0, 2.5))
    with world.store("one") as one, world.store("two") as two:
        first, second = one.add("robot", "x"), two.add("other", "x")
        one.take(first)
        two.take(second)
        assert one.claim(first, ["elevator", "door1"], 0.2) is None
        assert two.claim(second, ["door2", "elevator"], 5.0) == "elevator"
        assert world.ask("SELECT count(*) FROM reservation") == [(2,)]  # all or none
        for _ in range(4):
            time.sleep(0.1)
            assert one.beat(first, 0.3).claims == {"elevator", "door1"}
            assert two.claim(second, ["elevator"], 5.0) == "elevator"
        time.sleep(0.35)
        assert two.claim(second, ["elevator"], 5.0) is None
        assert one.beat(first, 0.3).claims == {"door1"}
        one.release(first, ["elevator"])  # is not its own any more
        assert two.beat(second, 5.0).claims == {"elevator"}


def test_two_robots_and_one_elevator(world: World) -> None:
    """They change storeys, round after round, in the same elevator and through the same doors."""
    world.add_robot("other", "foyer-3rd", UPSTAIRS)
    results: list[tuple[str, str]] = []

    def rounds(robot: str, first: bool) -> None:
        own = SimWorld(world.file)
        body = SimulatedRobot(robot, own, world.topology, speed=SPEED)
        with world.store(robot) as store:
            runner = Runner(store, body, simple_planner, speed=SPEED, tick=0.001, expiry=20.0)
            for i in range(ROUNDS):
                goal = "foyer-3rd" if first == (i % 2 == 0) else "foyer-1st"
                found = runner.run(store.add(robot, f"in(robot, {goal})"))
                results.append((found.state, str(found.reason)))
        own.close()

    together([lambda: rounds("robot", True), lambda: rounds("other", False)])
    assert set(results) == {("done", "None")}
    assert len(results) == 2 * ROUNDS
    check_the_elevator(world)
    assert world.ask("SELECT count(*) FROM reservation") == [(0,)]
    world.check("robot")
    world.check("other")


def check_the_elevator(world: World) -> None:
    """Nobody calls it or enters it while another is in it."""
    inside: str | None = None
    for robot, what, about in world.world.events():
        if about != "elevator":
            continue
        if what in ("called", "entered"):
            assert inside in (None, robot)
        if what in ("entered", "left"):
            inside = robot if what == "entered" else None


def test_the_claim_of_a_robot_that_died_expires(world: World) -> None:
    world.add_robot("other", "foyer-3rd", UPSTAIRS)
    with world.store() as store:
        mission = store.add("robot", "in(robot, foyer-3rd)")
    at = ("started", "call_elevator(elevator)")
    assert run_and_die(world.url, world.file, mission, "robot", expiry=1.5, at=at) == at
    assert world.ask("SELECT count(*) FROM reservation") == [(1,)]
    heard = []
    began = time.monotonic()
    result = world.run(
        "in(robot, foyer-1st)", "other", tick=0.01, speed=50.0, on_event=heard.append
    )
    assert result.state == "done"
    assert time.monotonic() - began > 0.5
    assert "elevator is in use" in [e.message for e in heard if e.kind == "waits"]
    check_the_elevator(world)
    assert run_and_die(world.url, world.file, mission, "robot") == 0
    assert world.ask("SELECT state FROM mission WHERE id = :m", m=mission) == [("done",)]
    world.check("robot")
    world.check("other")


@pytest.mark.parametrize("dead_in", ["elevator-1st", "elevator-3rd"])
def test_who_died_in_the_cabin_gets_out_of_it(world: World, dead_in: str) -> None:
    """The other finds the cabin occupied, gives the elevator back, and waits."""
    world.add_robot("other", "foyer-3rd", UPSTAIRS)
    with world.store() as store:
        mission = store.add("robot", "in(robot, foyer-3rd)")
    command = "use_elevator(elevator, elevator-1st, elevator-3rd)"
    at = ("started" if dead_in == "elevator-1st" else "ended", command)
    assert run_and_die(world.url, world.file, mission, "robot", expiry=0.1, at=at) == at
    results: list[Any] = []
    together(
        [
            lambda: results.append(other_goes_down(world)),
            lambda: (time.sleep(0.5), run_and_die(world.url, world.file, mission, "robot")),
        ]
    )
    assert results[0].state == "done"
    assert world.ask("SELECT state FROM mission WHERE id = :m", m=mission) == [("done",)]
    check_the_elevator(world)


def other_goes_down(world: World) -> Any:
    own = SimWorld(world.file)
    body = SimulatedRobot("other", own, world.topology, speed=200.0)
    with world.store("other") as store:
        runner = Runner(
            store, body, simple_planner, speed=200.0, tick=0.005, retry_policy=RetryPolicy(50, 100)
        )
        result = runner.run(store.add("other", "in(robot, foyer-1st)"))
    own.close()
    return result


def together(tasks: list[Any]) -> None:
    """Run at once; the first error is raised."""
    errors: list[BaseException] = []

    def guarded(task: Any) -> None:
        try:
            task()
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=guarded, args=(t,)) for t in tasks]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if errors:
        raise errors[0]
