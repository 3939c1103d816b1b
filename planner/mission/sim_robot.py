"""A simulated robot that drives on costmaps and fails on demand."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from planner.mission.behaviours import Outcome, RobotObservation
from planner.mission.command import Command
from planner.mission.sim_body import PathFinder, SimBody, Work, cabin_doors
from planner.mission.sim_drive import navigate, switch_map
from planner.mission.sim_hands import pickup, place
from planner.mission.sim_passages import (
    call_elevator,
    open_door,
    pass_connector,
    unlock_door,
    use_elevator,
)
from planner.mission.sim_world import SimWorld
from planner.topology import Topology

SIGHT = 1.0
"""Metres from the robot to connectors whose state it sees."""


class SimBehaviour:
    """A running behaviour of the simulated robot."""

    def __init__(self, work: Work, speed: float) -> None:
        self._work = work
        self._speed = speed
        self._since = time.monotonic()
        self._seconds: float | None = None

    def poll(self) -> Outcome | None:
        """How the behaviour ended; None while it runs."""
        at = (time.monotonic() - self._since) * self._speed
        try:
            if self._seconds is None:
                self._seconds = next(self._work)
            self._seconds = self._work.send(at)
        except StopIteration as end:
            cause, message = end.value
            return Outcome(cause, message, min(at, self._seconds or 0.0))
        return None

    def cancel(self) -> None:
        """Stop at once."""
        self._work.close()


def _behaviour(
    work: Callable[[SimBody, Command], Work],
) -> Callable[[SimulatedRobot, Command], SimBehaviour]:
    """The method that starts a behaviour."""

    def start(self: SimulatedRobot, command: Command) -> SimBehaviour:
        return SimBehaviour(work(self._body, command), self.speed)

    start.__doc__ = work.__doc__
    return start


class SimulatedRobot:
    """A robot in a simulated world, with every behaviour that importers assign to connectors.

    By its clock, which runs `speed` times faster than real time, it drives `velocity` m/s along the
    points that `path` finds, by default straight lines, and waits `wait` seconds for an elevator
    that another robot uses. `seed` is that of random failures.
    """

    navigate = _behaviour(navigate)
    switch_map = _behaviour(switch_map)
    open_door = _behaviour(open_door)
    unlock_door = _behaviour(unlock_door)
    pass_door = _behaviour(pass_connector)
    drive_through = _behaviour(pass_connector)
    climb_stairs = _behaviour(pass_connector)
    call_elevator = _behaviour(call_elevator)
    use_elevator = _behaviour(use_elevator)
    pickup = _behaviour(pickup)
    place = _behaviour(place)

    def __init__(
        self,
        name: str,
        world: SimWorld,
        topology: Topology,
        *,
        path: PathFinder | None = None,
        speed: float = 1.0,
        velocity: float = 1.0,
        seed: int = 0,
        wait: float = 60.0,
    ) -> None:
        if not (speed > 0 and 0 < velocity < math.inf):
            raise ValueError(f"speed is {speed} and velocity {velocity} m/s; give numbers above 0")
        self.name = name
        self.speed = speed
        straight: PathFinder = lambda place, a, b: np.array([a[:2], b[:2]])  # noqa: E731
        self._body = SimBody(
            name, world, cabin_doors(topology), path or straight, velocity, seed, wait
        )
        self._approach_poses = {c.name: c.poses for c in topology.connectors.values()}

    def observe(self) -> RobotObservation:
        """Everything in its place, and the connectors near it."""
        world = self._body.world
        with world.change():
            place, pose = world.robot(self.name)
            objects = {n: seen for n, (_, seen) in world.objects(place).items()}
            doors = {
                name: world.door(name)
                for name, poses in self._approach_poses.items()
                if min(math.dist(pose[:3], p[:3]) for p in poses) < SIGHT
            }
        holds = {n: seen.pose for n, seen in objects.items() if seen.holder == self.name}
        seen = {n: s for n, s in objects.items() if not world.has_robot(s.holder)}
        return RobotObservation(place, pose, holds, seen, doors)
