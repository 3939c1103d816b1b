"""A simulated robot that drives on costmaps and fails on demand."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator
from functools import wraps
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.mission.behaviours import Cause, Outcome, RobotObservation, Sighting
from planner.mission.command import Command
from planner.mission.sim_world import SimWorld
from planner.topology import Topology
from semmap.geometry.pose import Pose

GRIP = Pose(0.3, 0.0, 0.8)  # pose of a held object, in the robot's frame
REACH = 1.5  # metres from the robot's base to the objects that it takes
SIGHT = 1.0  # metres from the robot to connectors whose state it sees

PathFinder = Callable[[str, Pose, Pose], NDArray[np.float64] | None]
"""Returns the path in a place between two poses, (N, 2) points in the map's frame, or None."""

Failure = tuple[Cause, str]
Work = Generator[float, float, tuple[Cause | None, str]]
"""A running behaviour: receives its seconds so far, yields its duration, returns its outcome."""


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


def behaviour(work: Callable[[Any, Command], Work]) -> Callable[[Any, Command], SimBehaviour]:
    """The method of a simulated robot that starts this work."""

    @wraps(work)
    def start(robot: Any, command: Command) -> SimBehaviour:
        return SimBehaviour(work(robot, command), robot.speed)

    return start


def lasting(seconds: float, until: float = 1.0) -> Generator[float, float, None]:
    """Wait until a behaviour of so many seconds has run for a share of them."""
    while (yield seconds) < until * seconds:
        pass


class SimulatedRobot:
    """A robot in a simulated world, with every behaviour that importers assign to connectors.

    By its clock, which runs `speed` times faster than real time, it drives `velocity` m/s along the
    points that `path` finds, by default straight lines, and waits `wait` seconds for an elevator
    that another robot uses. `seed` is that of random failures.
    """

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
        straight: PathFinder = lambda place, a, b: np.array([a[:2], b[:2]])  # noqa: E731
        self.name, self.world, self.speed = name, world, speed
        self.velocity, self._path = velocity, path or straight
        self._seed, self._wait = seed, wait
        self._approach_poses = {c.name: c.poses for c in topology.connectors.values()}
        self._cabins = {  # of each elevator, the cabin behind each of its doors
            lift: {c.name: p for c in topology.connectors.values() for p in c.places if p in cabins}
            for lift, cabins in topology.cabins().items()
        }

    def observe(self) -> RobotObservation:
        """Everything in its place, and the connectors near it."""
        world = self.world
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

    def fails(self, what: str) -> bool:
        """Whether a behaviour fails this time."""
        return self.world.fails(self.name, what, self._seed)

    def _stands_at(self, command: Command) -> bool:
        return command.begins(*self.world.robot(self.name))

    def _misplaced(self, command: Command) -> Failure:
        """The outcome of a command that begins elsewhere than where the robot is."""
        place, pose = self.world.robot(self.name)
        return "misplaced", f"{command} does not begin in {place} at ({pose.x:.2f}, {pose.y:.2f})"

    def _lift_of(self, door: str) -> str | None:
        """The elevator behind a door."""
        return next((lift for lift, doors in self._cabins.items() if door in doors), None)

    @behaviour
    def navigate(self, command: Command) -> Work:
        """Drive along a path, on the costmap if there is one."""
        step, world = command.step, self.world
        assert step is not None
        place, pose = world.robot(self.name)
        if place != step.from_place:
            return self._misplaced(command)
        points = self._path(place, pose, step.leave)
        if points is None:
            return "blocked", f"no path leads there in {place}"
        fails = self.fails("navigate")
        drops = bool(self._held()) and self.fails("drop")
        seconds = sum(math.dist(a, b) for a, b in pairwise(points)) / self.velocity
        at = 0.0
        while at < seconds:
            at = min((yield seconds), seconds)
            share = at / seconds
            if (fails or drops) and share >= 0.5:
                with world.change():
                    world.put_robot(self.name, place, _along(points, 0.5, pose))
                    if drops:
                        return self._drop(place)
                return "blocked", f"something stands in the way in {place}"
            world.put_robot(self.name, place, _along(points, share, pose))
        world.put_robot(self.name, place, step.leave)
        return None, ""

    @behaviour
    def switch_map(self, command: Command) -> Work:
        """Switch at once."""
        yield from lasting(command.seconds)
        return ("unable", "the map is not there") if self.fails("switch_map") else (None, "")

    @behaviour
    def pickup(self, command: Command) -> Work:
        """Take the object from its true place."""
        item, world = command.arguments[0], self.world
        yield from lasting(command.seconds, 0.5)
        with world.change():
            here, pose = world.robot(self.name)
            there, seen = world.objects().get(item, ("", None))
            if seen is None or there != here or world.has_robot(seen.holder):
                return "gone", f"{item} is not there"
            if math.dist(pose[:2], seen.pose[:2]) > REACH:
                return "misplaced", f"{item} is out of reach"
            if self.fails("pickup"):
                return "missed", f"the grasp of {item} failed"
            world.put_object(item, here, Sighting(self.name, "in", GRIP))
            world.log(self.name, "took", item)
        yield from lasting(command.seconds)
        return None, ""

    def _placing(self, command: Command) -> Work:
        item, target, world = command.arguments[0], command.arguments[-1], self.world
        assert command.spot is not None
        yield from lasting(command.seconds, 0.5)
        with world.change():
            here, _ = world.robot(self.name)
            _, seen = world.objects().get(item, ("", None))
            if seen is None or seen.holder != self.name:
                return "gone", f"{item} is not in its gripper"
            if self.fails("place"):
                return self._drop(here)
            sighting = Sighting(target, "in" if target == here else "on", command.spot)
            world.put_object(item, here, sighting)
            world.log(self.name, "put", item)
        yield from lasting(command.seconds)
        return None, ""

    @behaviour
    def place(self, command: Command) -> Work:
        """Put the object down at `command.spot`."""
        return (yield from self._placing(command))

    def _drop(self, place: str) -> Failure:
        """Let all objects fall in front of the robot."""
        ahead = self.world.robot(self.name)[1] @ Pose(0.4, 0.0, 0.0)
        dropped = self._held()
        for name in dropped:
            self.world.put_object(name, place, Sighting(place, "in", ahead))
            self.world.log(self.name, "dropped", name)
        return "dropped", f"{', '.join(dropped)} fell down in {place}"

    def _held(self) -> list[str]:
        return [n for n, (_, seen) in self.world.objects().items() if seen.holder == self.name]

    @behaviour
    def open_door(self, command: Command) -> Work:
        """Leave the door ajar: it closes again behind the robot."""
        return (yield from self._open(command, unlocks=False))

    @behaviour
    def unlock_door(self, command: Command) -> Work:
        """Leave the door ajar."""
        return (yield from self._open(command, unlocks=True))

    def _open(self, command: Command, *, unlocks: bool) -> Work:
        name, world = _connector(command), self.world
        yield from lasting(command.seconds)
        with world.change():
            if not self._stands_at(command):
                return self._misplaced(command)
            state, lift = world.door(name), self._lift_of(name)
            if state == "locked" and not unlocks:
                return "locked", f"{name} is locked"
            if self.fails(command.behaviour):
                return "closed", f"{name} does not open"
            if state == "locked":
                world.set_door(name, "closed")
            is_there = lift is None or world.elevator(lift)[0] == self._cabins[lift][name]
            if state in ("closed", "locked") and is_there:
                world.set_door(name, "ajar")
            elif state == "closed":
                return "absent", f"the elevator is not behind {name}"
        return None, ""

    @behaviour
    def pass_door(self, command: Command) -> Work:
        """Pass a connector that is open or ajar: a door, an opening, a ramp or stairs."""
        step, name, world = command.step, _connector(command), self.world
        assert step is not None
        with world.change():
            obstacle = self._obstacle(command)
        if obstacle is not None:
            return obstacle
        fails = self.fails(command.behaviour)
        crossed = False
        at, seconds = 0.0, max(command.seconds, 1e-3)
        while at < seconds:
            at = min((yield seconds), seconds)
            if fails and at >= 0.25 * seconds:
                return "blocked", f"something stands in {name}"
            if at >= 0.5 * seconds and not crossed:
                crossed = True
                with world.change():
                    self._cross(command)
        with world.change():
            world.put_robot(self.name, step.to_place, step.leave)
            if world.door(name) == "ajar" and self._lift_of(name) is None:
                world.set_door(name, "closed")  # left as it was
        return None, ""

    drive_through = climb_stairs = pass_door

    def _obstacle(self, command: Command) -> Failure | None:
        """Why the robot cannot begin to pass a connector."""
        step, name = command.step, _connector(command)
        assert step is not None
        if not self._stands_at(command):
            return self._misplaced(command)
        state = self.world.door(name)
        if state == "locked":
            return "locked", f"{name} is locked"
        lift = self._lift_of(name)
        # the door of a lift opens to whoever is in its cabin
        inside = lift is not None and self.world.elevator(lift)[0] == step.from_place
        if state == "closed" and not inside:
            return "closed", f"{name} is closed"
        if lift is not None:
            cabin, occupant = self.world.elevator(lift)
            if cabin not in (step.from_place, step.to_place):
                return "absent", f"{lift} is not behind {name}"
            if occupant not in (None, self.name):
                return "blocked", f"{occupant} is in {lift}"
        return None

    def _cross(self, command: Command) -> None:
        """Put the robot, and what it holds, on the other side."""
        step, name, world = command.step, _connector(command), self.world
        assert step is not None
        middle = _between(step.approach or step.leave, step.leave, 0.6)
        world.put_robot(self.name, step.to_place, middle)
        world.carry(self.name, step.to_place)
        world.log(self.name, "passed", name)
        lift = self._lift_of(name)
        if lift is not None:
            cabin = world.elevator(lift)[0]
            inside = cabin == step.to_place
            world.log(self.name, "entered" if inside else "left", lift)
            world.set_elevator(lift, cabin, self.name if inside else None)
            world.set_door(name, "ajar")

    @behaviour
    def call_elevator(self, command: Command) -> Work:
        """The elevator comes, unless another robot is in it."""
        step, name, world = command.step, _connector(command), self.world
        assert step is not None
        lift = str(step.elevator)
        at = yield command.seconds
        while at < command.seconds:
            at = yield command.seconds
        while True:
            with world.change():
                if not self._stands_at(command):
                    return self._misplaced(command)
                if world.is_broken(lift) or self.fails("call_elevator"):
                    return "absent", f"{lift} does not come"
                _, occupant = world.elevator(lift)
                if occupant in (None, self.name):
                    world.set_elevator(lift, self._cabins[lift][name], None)
                    world.set_door(name, "ajar")
                    world.log(self.name, "called", lift)
                    return None, ""
            if at >= command.seconds + self._wait:
                return "absent", f"{lift} does not come: {occupant} is in it"
            at = yield at

    @behaviour
    def use_elevator(self, command: Command) -> Work:
        """Ride to another storey."""
        step, world = command.step, self.world
        assert step is not None
        lift = str(step.elevator)
        with world.change():
            place, _ = world.robot(self.name)
            if place != step.from_place or world.elevator(lift)[0] != place:
                return self._misplaced(command)
            if world.is_broken(lift) or self.fails("use_elevator"):
                return "absent", f"{lift} does not leave"
        yield from lasting(command.seconds)
        with world.change():
            world.set_elevator(lift, step.to_place, self.name)
            for name, cabin in self._cabins[lift].items():
                if cabin == step.to_place:
                    world.set_door(name, "ajar")
            world.put_robot(self.name, step.to_place, step.leave)
            world.carry(self.name, step.to_place)
            world.log(self.name, "rode", lift)
        return None, ""


def _connector(command: Command) -> str:
    assert command.step is not None
    assert command.step.connector is not None
    return command.step.connector.name


def _between(a: Pose, b: Pose, share: float) -> Pose:
    x, y, z = (p + (q - p) * share for p, q in zip(a[:3], b[:3], strict=True))
    return Pose(x, y, z, b.qx, b.qy, b.qz, b.qw)


def _along(points: NDArray[np.float64], share: float, on: Pose) -> Pose:
    """The pose at a share of the length of a line, looking along it."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    left = share * steps.sum()
    for (a, b), length in zip(pairwise(points), steps, strict=True):
        if left <= length and length > 0:
            x, y = a + (b - a) * (left / length)
            yaw = math.atan2(b[1] - a[1], b[0] - a[0])
            return Pose.planar(float(x), float(y), yaw, on.z)
        left -= length
    return on
