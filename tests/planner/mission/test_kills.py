"""kill -9 in the middle of everything: the mission goes on, and the map never claims too much."""

from __future__ import annotations

import os
import random

import pytest

from semmap.geometry.pose import Pose
from tests.planner.mission.conftest import World
from tests.planner.mission.runs import run_and_die

ROUNDS = 200 if "SEMMAP_SOAK" in os.environ else 3
FAILURES = (
    "pickup fails 0.2",
    "drop fails 0.1",
    "navigate fails 0.05",
    "pass_door fails 0.05",
    "call_elevator fails 0.1",
    "open_door fails 0.1",
    "place fails 0.1",
)
LOCKED = ("door6 locked", "door7 locked", "door5 locked", "door2 locked")


def check_what_it_claims(world: World) -> None:
    """Nothing that has not happened; and all that has where no step was begun."""
    begun = world.ask("SELECT action FROM mission_step WHERE state = 'started'")
    if not begun:
        world.check()
        return
    happened = [(what, about) for _, what, about in world.world.events()]
    holder, relation = world.holder("muffin1")
    if holder == "robot":
        assert ("took", "muffin1") in happened
    elif (holder, relation) == ("desk1", "on"):
        assert ("put", "muffin1") in happened
    elif (holder, relation) != ("desk4", "on"):
        assert ("dropped", "muffin1") in happened
        assert relation == "in"
    place, _ = world.holder("robot")
    passed = {about for what, about in happened if what in ("passed", "rode")}
    been = {"lab1", "corridor3"} | {
        p
        for n in passed
        if n in world.topology.connectors
        for p in world.topology.connectors[n].places
    }
    assert place in been | ({"elevator-3rd"} if "elevator" in passed else set())


def test_killed_once_at_every_moment(world: World) -> None:
    with world.store() as store:
        mission = store.add("robot", "on(muffin, desk1)")
    moments: set[tuple[str, str]] = set()
    while True:
        at = run_and_die(world.url, world.file, mission, "robot", died_at=frozenset(moments))
        check_what_it_claims(world)
        if at == 0:
            break
        assert isinstance(at, tuple)
        assert at not in moments
        moments.add(at)
    assert {what for what, _ in moments} == {"planned", "started", "acted", "ended", "failed"}
    assert len(moments) > 40
    assert world.ask("SELECT state FROM mission") == [("done",)]
    assert world.holder("muffin1") == ("desk1", "on")
    world.check()
    done = [(what, about) for _, what, about in world.world.events()]
    assert len(done) == len(set(done))  # no action twice
    assert [about for what, about in done if what == "passed"] == [
        "door1",
        "door2",
        "edoor1",
        "edoor3",
        "door5",
        "door6",
        "door7",
        "door8",
    ]


@pytest.mark.parametrize("first", range(0, ROUNDS, 6))
def test_failures_and_kills_by_chance(world: World, first: int) -> None:
    for seed in range(first, min(first + 6, ROUNDS)):
        draw = random.Random(seed)
        world.world.close()
        world.begin_anew()
        if seed % 2:  # a shorter way
            world.add_robot("robot", "corridor3", Pose.planar(8.0, 5.2, 0.0, 7.0))
        world.fail(*draw.sample(FAILURES, 3), *draw.sample(LOCKED, draw.randrange(2)))
        with world.store() as store:
            mission = store.add("robot", "on(muffin, desk1)")
        for life in range(200):
            chance = 0.05 if life < 3 else 0.0
            at = run_and_die(
                world.url,
                world.file,
                mission,
                "robot",
                chance=chance,
                seed=1000 * seed + life,
                speed=2000.0,
            )
            check_what_it_claims(world)
            if at == 0:
                break
        ((state, reason),) = world.ask("SELECT state, reason FROM mission")
        assert state in ("done", "failed"), seed
        assert (reason is None) == (state == "done")
        assert (world.holder("muffin1") == ("desk1", "on")) == (state == "done")
        world.check()
        for name, door in world.topology.connectors.items():
            ((told,),) = world.ask(
                "SELECT state FROM connector WHERE entity_id = entity_id(:name)", name=name
            )
            assert told in (door.state, world.world.door(name))
