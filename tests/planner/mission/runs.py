"""Runners in processes of their own, which are killed where a test says so."""

from __future__ import annotations

import os
import random
import signal
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from sqlalchemy import create_engine

from planner.mission import Command, MissionStore, Runner
from planner.mission.behaviours import Outcome, RunningBehaviour
from planner.mission.runner import MissionEvent
from planner.mission.sim_robot import SimulatedRobot
from planner.mission.sim_world import SimWorld
from semmap.query.map_handle import MapHandle
from tests.forked import context
from tests.planner.mission.simple import simple_planner

SOAK = "SEMMAP_SOAK" in os.environ


def run_and_die(
    url: str,
    file: Path,
    mission: int,
    robot: str,
    *,
    chance: float = 0.0,
    seed: int = 0,
    died_at: frozenset[tuple[str, str]] | None = None,
    speed: float = 1e5,
    expiry: float = 30.0,
    at: tuple[str, str] | None = None,
) -> int | tuple[str, str]:
    """Run a mission in a process that is killed; 0 where it came to the mission's end.

    Parameters
    ----------
    died_at : it dies at the first moment (event, command) that is not among these, and returns it
    at : it dies at this moment alone
    chance : it dies so probably at each look at the robot
    """
    here, there = context.Pipe(duplex=False)
    process = context.Process(
        target=_child,
        args=(there, url, file, mission, robot, chance, seed, died_at, speed, expiry, at),
    )
    process.start()
    there.close()
    process.join(60)
    assert process.exitcode in (0, -signal.SIGKILL), process.exitcode
    try:
        said: tuple[str, str] | None = here.recv()
    except EOFError:  # it said nothing
        said = None
    here.close()
    code = process.exitcode
    process.close()
    return said or code


def _child(
    pipe: Any,
    url: str,
    file: Path,
    mission: int,
    robot: str,
    chance: float,
    seed: int,
    died_at: frozenset[tuple[str, str]] | None,
    speed: float,
    expiry: float,
    at: tuple[str, str] | None,
) -> None:
    draw = random.Random(seed)

    def die() -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    def on_event(event: MissionEvent) -> None:
        moment = (event.kind, str(event.command))
        ends = event.command is None and event.kind != "planned"
        if ends or event.kind not in kinds_of(event.command):
            return
        if (died_at is not None and moment not in died_at) or moment == at:
            pipe.send(moment)
            die()

    def look() -> None:
        if draw.random() < chance:
            die()

    engine = create_engine(url, connect_args={"options": "-c search_path=semmap,public"})
    opened = MissionStore(MapHandle(engine, "office"), f"{os.getpid()}")
    with opened as store, closing(SimWorld(file)) as world:
        body = Mortal(SimulatedRobot(robot, world, store.topology(), speed=speed), look)
        Runner(
            store, body, simple_planner, speed=speed, tick=0.0005, expiry=expiry, on_event=on_event
        ).run(mission)


def kinds_of(command: Command | None) -> tuple[str, ...]:
    """The moments at which it may die: a step that ended is like one that has not begun yet."""
    handles = command is None or command.behaviour in ("pickup", "place", "use_elevator")
    return (
        ("planned", "started", "acted", "ended", "failed")
        if handles or SOAK
        else ("started", "acted")
    )


class Mortal:
    """A robot whose runner may die whenever it looks at it."""

    def __init__(self, robot: SimulatedRobot, look: Callable[[], None]) -> None:
        self._robot = robot
        self._look = look

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._robot, name)
        if name == "observe":
            self._look()
            return found
        return lambda command: _Watched(found(command), self._look)


class _Watched:
    def __init__(self, doing: RunningBehaviour, look: Callable[[], None]) -> None:
        self._doing = doing
        self._look = look

    def poll(self) -> Outcome | None:
        self._look()
        outcome = self._doing.poll()
        self._look()
        return outcome

    def cancel(self) -> None:
        self._doing.cancel()


__all__ = ["Command", "run_and_die"]
