"""Missions in a simulated office: what is done, what fails, and what the map says of it."""

from __future__ import annotations

import os

import pytest
from sqlalchemy import create_engine

from planner.mission import MissionError, Sighting
from planner.mission.runner import MissionEvent
from planner.mission.store.missions import LostMissionError
from semmap.geometry.pose import Pose
from tests.planner.mission.conftest import START, World


def test_the_muffin_of_figure_4_is_brought_to_desk1(world: World) -> None:
    assert world.run().state == "done"
    assert world.holder("muffin1") == ("desk1", "on")
    world.check()
    with world.store() as store:
        (mission,) = store.missions()
        steps = store.steps(mission["id"])
    assert {s["state"] for s in steps} == {"done"}
    shown = ("navigate", "switch_map", "open_door")
    assert [(s["action"], *s["arguments"][:1]) for s in steps if s["action"] not in shown] == [
        ("pass_door", "door1"),
        ("pass_door", "door2"),
        ("call_elevator", "elevator"),
        ("pass_door", "edoor1"),
        ("use_elevator", "elevator"),
        ("pass_door", "edoor3"),
        ("pass_door", "door5"),
        ("pass_door", "door6"),
        ("pickup", "muffin1"),
        ("pass_door", "door7"),
        ("pass_door", "door8"),
        ("place", "muffin1"),
    ]
    assert world.ask("SELECT count(*) FROM reservation") == [(0,)]
    took = dict(world.ask("SELECT behaviour, count(*) FROM execution WHERE succeeded GROUP BY 1"))
    assert took == {"pass_door": 8, "call_elevator": 1, "use_elevator": 1}


def test_a_door_found_locked_is_told_with_its_time_and_another_way_taken(world: World) -> None:
    world.fail("door6 locked")
    assert world.run().state == "done"
    ((state, seen),) = world.ask(
        "SELECT state, now() - seen_at < '1 minute' FROM connector "
        "WHERE entity_id = entity_id('door6')"
    )
    assert (state, seen) == ("locked", True)
    passed = [about for _, what, about in world.world.events() if what == "passed"]
    assert passed == ["door1", "door2", "edoor1", "edoor3", "door5", "door7", "door7", "door8"]
    world.check()


@pytest.mark.parametrize("door", ["door5", "door6"])
def test_a_door_that_is_locked_in_the_map_stays_open_in_the_world(world: World, door: str) -> None:
    """The map is what the robot knows: it passes, and the map has what it saw."""
    state = "SELECT state FROM connector WHERE entity_id = entity_id(:door)"

    def lock(event: MissionEvent) -> None:
        if event.kind == "started" and event.number == 2:
            locked = "UPDATE connector SET state = 'locked' WHERE entity_id = entity_id(:door)"
            assert world.ask(f"{locked} RETURNING state", door=door) == [("locked",)]

    assert world.run(on_event=lock).state == "done"
    assert ("robot", "passed", door) in world.world.events()
    assert world.world.door(door) == "open"
    assert world.ask(state, door=door) == [("open",)]


def test_the_only_way_is_locked(world: World) -> None:
    world.fail("door5 locked")
    result = world.run()
    assert (result.state, "door5 is locked" in result.reason) == ("failed", True)
    assert world.holder("muffin1") == ("desk4", "on")
    world.check()


@pytest.mark.parametrize(
    "said",
    [
        "pickup fails twice",
        "drop fails once",
        "navigate fails twice",
        "pass_door fails twice",
        "call_elevator fails twice",
        "use_elevator fails once",
        "place fails once",
        "open_door fails twice",
        "switch_map fails once",
    ],
)
def test_what_fails_is_tried_again(world: World, said: str) -> None:
    if said.startswith("open_door"):
        world.ask(
            "UPDATE connector SET state = 'closed' "
            "WHERE entity_id = entity_id('door5') RETURNING state"
        )
        with world.world.change():
            world.world.set_door("door5", "closed")
    world.fail(said)
    assert world.run().state == "done"
    assert world.holder("muffin1") == ("desk1", "on")
    world.check()
    failed = world.ask("SELECT count(*) FROM mission_step WHERE state = 'failed'")
    assert failed == [({"once": 1, "twice": 2}[said.split()[-1]],)]


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ("pickup fails 9", "pickup of muffin1 failed 3 times: the grasp"),
        ("pickup fails 9", "; without muffin1: no muffin is left"),
        ("call_elevator fails 9", "call_elevator of elevator failed 3 times"),
        ("navigate fails 99", "navigate failed 6 times: something stands in the way"),
    ],
)
def test_patience_has_an_end_and_says_why(world: World, said: str, reason: str) -> None:
    world.fail(said)
    result = world.run()
    assert result.state == "failed"
    assert reason in result.reason
    assert world.ask("SELECT state, reason FROM mission") == [("failed", result.reason)]
    assert world.ask("SELECT count(*) FROM reservation") == [(0,)]
    world.check()


def test_after_three_grasps_another_muffin(world: World) -> None:
    at = world.world_pose("muffin1")
    world.add_muffin("office4", "desk4", Pose(at.x + 0.3, at.y, at.z))
    world.fail("pickup fails 3")
    assert world.run().state == "done"
    took = [about for _, what, about in world.world.events() if what in ("took", "put")]
    assert took[0] == took[1]
    assert {world.holder(m) for m in ("muffin1", "muffin2")} == {("desk1", "on"), ("desk4", "on")}
    tried = {
        about[0]
        for (about,) in world.ask("SELECT arguments FROM mission_step WHERE action = 'pickup'")
    }
    assert tried == {"muffin1", "muffin2"}
    world.check()


def test_two_muffins_lie_beside_each_other(world: World) -> None:
    at = world.world_pose("muffin1")
    world.add_muffin("office4", "desk4", Pose(at.x + 0.3, at.y, at.z))
    for muffin in ("muffin1", "muffin2"):
        assert world.run(f"on({muffin}, desk1)").state == "done"
    ((apart, above),) = world.ask(
        "SELECT ST_Distance(a.footprint, b.footprint), ST_ZMin(a.box) - ST_ZMax(d.box) "
        "FROM world a, world b, world d WHERE a.entity_id = entity_id('muffin1') "
        "AND b.entity_id = entity_id('muffin2') AND d.entity_id = entity_id('desk1')"
    )
    assert apart > 0
    assert abs(above) < 1e-6
    inside = world.ask(
        "SELECT bool_and(ST_Covers(d.footprint, a.footprint)) FROM world a, world d "
        "WHERE a.entity_id IN (entity_id('muffin1'), entity_id('muffin2')) "
        "AND d.entity_id = entity_id('desk1')"
    )
    assert inside == [(True,)]


def test_a_thing_that_somebody_moved_is_found_where_it_is(world: World) -> None:
    at = world.world_pose("muffin1")
    world.world.put_object(
        "muffin1", "office4", Sighting("office4", "in", Pose(at.x + 3, at.y, 7.0))
    )
    assert world.run().state == "done"
    world.check()


def test_a_goal_that_is_reached_needs_no_step(world: World) -> None:
    assert world.run("on(muffin, desk4)").state == "done"
    assert world.ask("SELECT count(*) FROM mission_step") == [(0,)]


def test_cancelled_in_the_middle(world: World) -> None:
    def on_event(event: MissionEvent) -> None:
        if (
            event.kind == "started"
            and event.command is not None
            and event.command.subject == "door6"
        ):
            with world.store() as other:
                assert other.cancel(event_mission())

    def event_mission() -> int:
        return int(world.ask("SELECT max(id) FROM mission")[0][0])

    result = world.run(on_event=on_event, expiry=0.001)
    assert result.state == "cancelled"
    assert world.ask("SELECT state FROM mission") == [("cancelled",)]
    assert world.ask("SELECT count(*) FROM mission_step WHERE state = 'planned'") == [(0,)]
    assert world.holder("muffin1") == ("desk4", "on")
    world.check()
    assert world.run().state == "done"  # the robot is free for another
    world.check()


def test_what_cannot_be_run(world: World) -> None:
    with world.store() as store, world.store("other") as other:
        with pytest.raises(MissionError, match="no robot named nobody"):
            store.add("nobody", "on(muffin, desk1)")
        with pytest.raises(MissionError, match="no mission 0"):
            store.take(0)
        number = store.add("robot", "on(muffin, desk4)")
        second = other.add("robot", "on(muffin, desk1)")
        store.take(number)
        with pytest.raises(MissionError, match="used by another process"):
            other.take(second, wait=0.0)
        with pytest.raises(MissionError, match="used by another process"):
            other.take(number, wait=0.1)
        store.finish(number, "done")
        with pytest.raises(MissionError, match="is done"):
            other.take(number)
        other.take(second)


def test_who_lost_a_mission_writes_nothing(world: World) -> None:
    with world.store("one") as one, world.store("two") as two:
        number = one.add("robot", "on(muffin, desk1)")
        one.take(number)
        world.ask(
            "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid IN "
            "(SELECT pid FROM pg_locks WHERE locktype = 'advisory')"
        )
        two.take(number)
    with world.store("one") as again:
        for write in (
            lambda: again.replan(number, []),
            lambda: again.finish(number, "done"),
            lambda: again.observe(number, world.robot().observe()),
            lambda: again.claim(number, ["elevator"], 1.0),
        ):
            with pytest.raises(LostMissionError):
                write()


def test_a_robot_role_has_the_rights(world: World) -> None:
    name = f"robot_{os.getpid()}"  # roles are the whole server's
    with world.engine.begin() as connection:
        connection.exec_driver_sql(f"CREATE ROLE {name} IN ROLE semmap_robot")
    world.add_robot(name, "lab1", START)
    world.engine.dispose()
    world.engine = create_engine(
        world.url, connect_args={"options": f"-c role={name} -c search_path=semmap,public"}
    )
    world.fail("door6 locked", "drop fails once")
    assert world.run(robot=name).state == "done"
    world.check(name)
