"""A simulated robot that drives on costmaps and fails on demand."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.mission.behaviours import Cause, Observation, Outcome, Sighting
from planner.mission.command import Command
from planner.mission.sim_world import SimWorld
from planner.topology import Topology
from semmap.geometry.pose import Pose

__all__ = ["PathFinder", "SimulatedRobot"]

_Work = Generator[float, float, "tuple[Cause | None, str]"]
"""A running behaviour: receives its seconds so far, yields its duration, returns its outcome."""

PathFinder = Callable[[str, Pose, Pose], NDArray[np.float64] | None]
"""Returns the path in a place between two poses, (N, 2) points in the map's frame, or None."""

GRIP = Pose(0.3, 0.0, 0.8)
"""Pose of a held object, in the robot's frame."""

REACH, SIGHT = 1.5, 1.0
"""Metres from its base to objects that it takes, and to connectors whose state it sees."""


class SimulatedRobot:
    """The behaviours of a robot in a simulated world.

    Parameters
    ----------
    path
        Finds paths inside places; by default straight lines.
    speed
        How much faster its clock runs than real time.
    velocity
        Metres a second, by its clock.
    seed
        Of random failures.
    wait
        Seconds, by its clock, that it waits for an elevator that another robot uses.
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
        self.name = name
        self.speed = speed
        self._world = world
        self._path = path or (lambda place, a, b: np.array([(a.x, a.y), (b.x, b.y)]))
        self._velocity = velocity
        self._seed = seed
        self._wait = wait
        self._approach_poses = {c.name: c.poses for c in topology.connectors.values()}
        self._cabin_doors: dict[str, dict[str, str]] = {  # of each elevator: door, cabin
            lift: {
                c.name: place
                for c in topology.connectors.values()
                for place in c.places
                if place in cabins
            }
            for lift, cabins in topology.cabins().items()
        }

    def observe(self) -> Observation:
        """Everything in its place, and the connectors near it."""
        with self._world.change():
            place, pose = self._world.robot(self.name)
            objects = {n: seen for n, (_, seen) in self._world.objects(place).items()}
            doors = {
                name: self._world.door(name)
                for name, poses in self._approach_poses.items()
                if min(math.dist(_xyz(pose), _xyz(p)) for p in poses) < SIGHT
            }
        holds = {n: seen.pose for n, seen in objects.items() if seen.holder == self.name}
        seen = {n: seen for n, seen in objects.items() if seen.holder != self.name}
        robots = {n for n, s in seen.items() if self._world.has_robot(s.holder)}
        return Observation(
            place, pose, holds, {n: s for n, s in seen.items() if n not in robots}, doors
        )

    # -- behaviours -----------------------------------------------------------------------------

    def navigate(self, command: Command) -> _SimBehaviour:
        """Drive along a path, on the costmap if there is one."""
        return _SimBehaviour(self, self._drive(command))

    def switch_map(self, command: Command) -> _SimBehaviour:
        """Switch at once."""
        return _SimBehaviour(self, self._switch(command))

    def open_door(self, command: Command) -> _SimBehaviour:
        """Leave the door ajar: it closes again behind the robot."""
        return _SimBehaviour(self, self._open(command, "closed"))

    def unlock_door(self, command: Command) -> _SimBehaviour:
        """Leave the door ajar."""
        return _SimBehaviour(self, self._open(command, "locked"))

    def pass_door(self, command: Command) -> _SimBehaviour:
        """Pass a door that is open or ajar."""
        return _SimBehaviour(self, self._pass(command))

    def call_elevator(self, command: Command) -> _SimBehaviour:
        """The elevator comes, unless another robot is in it."""
        return _SimBehaviour(self, self._call(command))

    def use_elevator(self, command: Command) -> _SimBehaviour:
        """Ride to another storey."""
        return _SimBehaviour(self, self._ride(command))

    def pickup(self, command: Command) -> _SimBehaviour:
        """Take the object from its true place."""
        return _SimBehaviour(self, self._take(command))

    def place(self, command: Command) -> _SimBehaviour:
        """Put the object down at `command.spot`."""
        return _SimBehaviour(self, self._put(command))

    # -- each yields how far in its seconds it is, and returns how it ended ---------------------

    def _drive(self, command: Command) -> _Work:
        step = command.step
        assert step is not None
        place, pose = self._world.robot(self.name)
        if place != step.from_place:
            return self._misplaced(command)
        points = self._path(place, pose, step.leave)
        if points is None:
            return "blocked", f"no path leads there in {place}"
        lengths = [math.dist(a, b) for a, b in pairwise(points)]
        total = sum(lengths)
        fails = self._fails("navigate")
        drops = bool(self.observe().holds) and self._fails("drop")
        seconds = total / self._velocity
        at = 0.0
        while at < seconds:
            at = min((yield seconds), seconds)
            share = at / seconds
            if (fails or drops) and share >= 0.5:
                with self._world.change():
                    self._world.put_robot(self.name, place, _along(points, 0.5, pose))
                    if drops:
                        return self._drop(place)
                return "blocked", f"something stands in the way in {place}"
            there = step.leave if share >= 1 else _along(points, share, pose)
            self._world.put_robot(self.name, place, there)
        self._world.put_robot(self.name, place, step.leave)
        return None, ""

    def _drop(self, place: str) -> tuple[Cause, str]:
        _, pose = self._world.robot(self.name)
        dropped = [n for n, (_, s) in self._world.objects(place).items() if s.holder == self.name]
        for name in dropped:
            ahead = pose @ Pose(0.4, 0.0, 0.0)
            self._world.put_object(name, place, Sighting(place, "in", ahead))
            self._world.log(self.name, "dropped", name)
        return "dropped", f"{', '.join(dropped)} fell down in {place}"

    def _open(self, command: Command, opens: str) -> _Work:
        name = self._connector(command)
        while (yield command.seconds) < command.seconds:
            pass
        with self._world.change():
            if not self._stands_at(command):
                return self._misplaced(command)
            state = self._world.door(name)
            if state == "locked" and opens != "locked":
                return "locked", f"{name} is locked"
            if self._fails(command.behaviour):
                return "closed", f"{name} does not open"
            if state == "locked":
                self._world.set_door(name, "closed")
            if state in ("closed", "locked") and self._is_there(name):
                self._world.set_door(name, "ajar")
            elif state == "closed":
                return "absent", f"the elevator is not behind {name}"
        return None, ""

    def _is_there(self, door: str) -> bool:
        """Whether a door is not an elevator door, or its elevator stands behind it."""
        for lift, doors in self._cabin_doors.items():
            if door in doors:
                return self._world.elevator(lift)[0] == doors[door]
        return True

    def _pass(self, command: Command) -> _Work:
        step, name = command.step, self._connector(command)
        assert step is not None
        lift = next((k for k, doors in self._cabin_doors.items() if name in doors), None)
        crossed = False
        at = 0.0
        seconds = max(command.seconds, 1e-3)
        with self._world.change():
            if not self._stands_at(command):
                return self._misplaced(command)
            state = self._world.door(name)
            if state == "locked":
                return "locked", f"{name} is locked"
            if state == "closed":
                return "closed", f"{name} is closed"
            if lift is not None:
                cabin, occupant = self._world.elevator(lift)
                if cabin not in (step.from_place, step.to_place):
                    return "absent", f"{lift} is not behind {name}"
                if occupant not in (None, self.name):
                    return "blocked", f"{occupant} is in {lift}"
        fails = self._fails("pass_door")
        while at < seconds:
            at = min((yield seconds), seconds)
            if fails and at >= 0.25 * seconds:
                return "blocked", f"something stands in {name}"
            if at >= 0.5 * seconds and not crossed:
                crossed = True
                with self._world.change():
                    middle = _between(step.approach or step.leave, step.leave, 0.6)
                    self._world.put_robot(self.name, step.to_place, middle)
                    self._world.carry(self.name, step.to_place)
                    self._world.log(self.name, "passed", name)
                    if lift is not None:
                        cabin = self._world.elevator(lift)[0]
                        inside = cabin == step.to_place
                        self._world.log(self.name, "entered" if inside else "left", lift)
                        self._world.set_elevator(lift, cabin, self.name if inside else None)
                        self._world.set_door(name, "ajar")
        with self._world.change():
            self._world.put_robot(self.name, step.to_place, step.leave)
            if self._world.door(name) == "ajar" and lift is None:
                self._world.set_door(name, "closed")  # left as it was
        return None, ""

    def _call(self, command: Command) -> _Work:
        step, name = command.step, self._connector(command)
        assert step is not None
        lift = str(step.elevator)
        at = yield command.seconds
        while at < command.seconds:
            at = yield command.seconds
        while True:
            with self._world.change():
                if not self._stands_at(command):
                    return self._misplaced(command)
                if self._fails("call_elevator"):
                    return "absent", f"{lift} does not come"
                _, occupant = self._world.elevator(lift)
                if occupant in (None, self.name):
                    self._world.set_elevator(lift, self._cabin_doors[lift][name], None)
                    self._world.set_door(name, "ajar")
                    self._world.log(self.name, "called", lift)
                    return None, ""
            if at >= command.seconds + self._wait:
                return "absent", f"{lift} does not come: {occupant} is in it"
            at = yield at

    def _ride(self, command: Command) -> _Work:
        step = command.step
        assert step is not None
        lift = str(step.elevator)
        with self._world.change():
            place, _ = self._world.robot(self.name)
            if place != step.from_place or self._world.elevator(lift)[0] != place:
                return self._misplaced(command)
            if self._fails("use_elevator"):
                return "absent", f"{lift} does not leave"
        while (yield command.seconds) < command.seconds:
            pass
        with self._world.change():
            self._world.set_elevator(lift, step.to_place, self.name)
            for name, cabin in self._cabin_doors[lift].items():
                if cabin == step.to_place:
                    self._world.set_door(name, "ajar")
            self._world.put_robot(self.name, step.to_place, step.leave)
            self._world.carry(self.name, step.to_place)
            self._world.log(self.name, "rode", lift)
        return None, ""

    def _take(self, command: Command) -> _Work:
        item = command.arguments[0]
        while (yield command.seconds) < command.seconds / 2:
            pass
        with self._world.change():
            place, pose = self._world.robot(self.name)
            there, seen = self._world.objects().get(item, ("", None))
            if seen is None or there != place or self._world.has_robot(seen.holder):
                return "gone", f"{item} is not there"
            if math.dist((pose.x, pose.y), (seen.pose.x, seen.pose.y)) > REACH:
                return "misplaced", f"{item} is out of reach"
            if self._fails("pickup"):
                return "missed", f"the grasp of {item} failed"
            self._world.put_object(item, place, Sighting(self.name, "in", GRIP))
            self._world.log(self.name, "took", item)
        while (yield command.seconds) < command.seconds:
            pass
        return None, ""

    def _put(self, command: Command) -> _Work:
        item, target = command.arguments[0], command.arguments[-1]
        assert command.spot is not None
        while (yield command.seconds) < command.seconds / 2:
            pass
        with self._world.change():
            place, _ = self._world.robot(self.name)
            _, seen = self._world.objects().get(item, ("", None))
            if seen is None or seen.holder != self.name:
                return "gone", f"{item} is not in its gripper"
            if self._fails("place"):
                return self._drop(place)
            relation = "in" if target == place else "on"
            self._world.put_object(item, place, Sighting(target, relation, command.spot))  # type: ignore[arg-type]
            self._world.log(self.name, "put", item)
        while (yield command.seconds) < command.seconds:
            pass
        return None, ""

    # -- what they share ------------------------------------------------------------------------

    def _switch(self, command: Command) -> _Work:
        while (yield command.seconds) < command.seconds:
            pass
        if self._fails("switch_map"):
            return "unable", "the map is not there"
        return None, ""

    def _fails(self, what: str) -> bool:
        return self._world.fails(self.name, what, self._seed)

    def _stands_at(self, command: Command) -> bool:
        place, pose = self._world.robot(self.name)
        return command.begins(place, pose)

    def _misplaced(self, command: Command) -> tuple[Cause, str]:
        place, pose = self._world.robot(self.name)
        return "misplaced", f"{command} does not begin in {place} at ({pose.x:.2f}, {pose.y:.2f})"

    def _connector(self, command: Command) -> str:
        assert command.step is not None
        assert command.step.connector is not None
        return command.step.connector.name


class _SimBehaviour:
    """A running behaviour of the simulated robot."""

    def __init__(self, robot: SimulatedRobot, work: _Work) -> None:
        self._robot = robot
        self._work = work
        self._since = time.monotonic()
        self._seconds: float | None = None

    def poll(self) -> Outcome | None:
        """How the behaviour ended; None while it runs."""
        at = (time.monotonic() - self._since) * self._robot.speed
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


def _between(a: Pose, b: Pose, share: float) -> Pose:
    x, y, z = (p + (q - p) * share for p, q in zip(_xyz(a), _xyz(b), strict=True))
    return Pose(x, y, z, b.qx, b.qy, b.qz, b.qw)


def _xyz(pose: Pose) -> tuple[float, float, float]:
    return pose.x, pose.y, pose.z
