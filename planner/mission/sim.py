"""A simulated robot: it drives the costmaps, and fails where it shall."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.mission.behaviours import Cause, Observation, Outcome, Seen
from planner.mission.stage import Stage
from planner.mission.truth import Truth
from planner.topology import Topology
from semmap.geometry.pose import Pose

__all__ = ["SimulatedRobot", "Way"]

_Work = Generator[float, float, "tuple[Cause | None, str]"]
"""A behaviour at work: told its seconds so far, it says how many it takes; then how it ended."""

Way = Callable[[str, Pose, Pose], NDArray[np.float64] | None]
"""The way in a place between two poses: (N, 2) points in the map's frame; None where none leads."""

GRIP = Pose(0.3, 0.0, 0.8)
"""Where it holds a thing, in its own frame."""

REACH, SIGHT = 1.5, 1.0
"""Metres from its base to what it takes, and to the connectors whose state it sees."""


class SimulatedRobot:
    """The behaviours of a robot in a simulated world.

    Parameters
    ----------
    way : the ways inside of places; straight if not given
    speed : how much faster than the wall's its clock runs
    velocity : metres a second, by its clock
    seed : of the failures that happen by chance
    wait : seconds, by its clock, that it waits for an elevator which somebody else is in
    """

    def __init__(
        self,
        name: str,
        truth: Truth,
        topology: Topology,
        *,
        way: Way | None = None,
        speed: float = 1.0,
        velocity: float = 1.0,
        seed: int = 0,
        wait: float = 60.0,
    ) -> None:
        if not (speed > 0 and 0 < velocity < math.inf):
            raise ValueError(f"speed is {speed} and velocity {velocity} m/s; give numbers above 0")
        self.name = name
        self.speed = speed
        self._truth = truth
        self._way = way or (lambda place, a, b: np.array([(a.x, a.y), (b.x, b.y)]))
        self._velocity = velocity
        self._seed = seed
        self._wait = wait
        self._stands = {c.name: c.poses for c in topology.connectors.values()}
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
        """All of the place that it is in, and the connectors beside it."""
        with self._truth.change():
            place, pose = self._truth.robot(self.name)
            things = {n: seen for n, (_, seen) in self._truth.things(place).items()}
            doors = {
                name: self._truth.door(name)
                for name, stands in self._stands.items()
                if min(math.dist(_xyz(pose), _xyz(p)) for p in stands) < SIGHT
            }
        holds = {n: seen.pose for n, seen in things.items() if seen.holder == self.name}
        seen = {n: seen for n, seen in things.items() if seen.holder != self.name}
        robots = {n for n, s in seen.items() if self._truth.has_robot(s.holder)}
        return Observation(
            place, pose, holds, {n: s for n, s in seen.items() if n not in robots}, doors
        )

    # -- behaviours -----------------------------------------------------------------------------

    def navigate(self, stage: Stage) -> _Doing:
        """Along the way, the costmap's where there is one."""
        return _Doing(self, self._drive(stage))

    def switch_map(self, stage: Stage) -> _Doing:
        """At once."""
        return _Doing(self, self._switch(stage))

    def open_door(self, stage: Stage) -> _Doing:
        """Ajar: it is shut again behind the robot."""
        return _Doing(self, self._open(stage, "closed"))

    def unlock_door(self, stage: Stage) -> _Doing:
        """Ajar, too."""
        return _Doing(self, self._open(stage, "locked"))

    def pass_door(self, stage: Stage) -> _Doing:
        """Through what is open or ajar."""
        return _Doing(self, self._pass(stage))

    def call_elevator(self, stage: Stage) -> _Doing:
        """It comes, unless somebody is in it."""
        return _Doing(self, self._call(stage))

    def use_elevator(self, stage: Stage) -> _Doing:
        """To another storey."""
        return _Doing(self, self._ride(stage))

    def pickup(self, stage: Stage) -> _Doing:
        """From where the thing truly is."""
        return _Doing(self, self._take(stage))

    def place(self, stage: Stage) -> _Doing:
        """To the spot."""
        return _Doing(self, self._put(stage))

    # -- each yields how far in its seconds it is, and returns how it ended ---------------------

    def _drive(self, stage: Stage) -> _Work:
        step = stage.step
        assert step is not None
        place, pose = self._truth.robot(self.name)
        if place != step.from_place:
            return self._misplaced(stage)
        points = self._way(place, pose, step.leave)
        if points is None:
            return "blocked", f"no way leads there in {place}"
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
                with self._truth.change():
                    self._truth.put_robot(self.name, place, _along(points, 0.5, pose))
                    if drops:
                        return self._drop(place)
                return "blocked", f"something stands in the way in {place}"
            there = step.leave if share >= 1 else _along(points, share, pose)
            self._truth.put_robot(self.name, place, there)
        self._truth.put_robot(self.name, place, step.leave)
        return None, ""

    def _drop(self, place: str) -> tuple[Cause, str]:
        _, pose = self._truth.robot(self.name)
        dropped = [n for n, (_, s) in self._truth.things(place).items() if s.holder == self.name]
        for name in dropped:
            ahead = pose @ Pose(0.4, 0.0, 0.0)
            self._truth.put_thing(name, place, Seen(place, "in", ahead))
            self._truth.log(self.name, "dropped", name)
        return "dropped", f"{', '.join(dropped)} fell down in {place}"

    def _open(self, stage: Stage, opens: str) -> _Work:
        name = self._connector(stage)
        while (yield stage.seconds) < stage.seconds:
            pass
        with self._truth.change():
            if not self._stands_at(stage):
                return self._misplaced(stage)
            state = self._truth.door(name)
            if state == "locked" and opens != "locked":
                return "locked", f"{name} is locked"
            if self._fails(stage.behaviour):
                return "closed", f"{name} does not open"
            if state == "locked":
                self._truth.set_door(name, "closed")
            if state in ("closed", "locked") and self._is_there(name):
                self._truth.set_door(name, "ajar")
            elif state == "closed":
                return "absent", f"the elevator is not behind {name}"
        return None, ""

    def _is_there(self, door: str) -> bool:
        """Whether a door is no elevator's, or its elevator stands behind it."""
        for lift, doors in self._cabin_doors.items():
            if door in doors:
                return self._truth.elevator(lift)[0] == doors[door]
        return True

    def _pass(self, stage: Stage) -> _Work:
        step, name = stage.step, self._connector(stage)
        assert step is not None
        lift = next((k for k, doors in self._cabin_doors.items() if name in doors), None)
        crossed = False
        at = 0.0
        seconds = max(stage.seconds, 1e-3)
        with self._truth.change():
            if not self._stands_at(stage):
                return self._misplaced(stage)
            state = self._truth.door(name)
            if state == "locked":
                return "locked", f"{name} is locked"
            if state == "closed":
                return "closed", f"{name} is closed"
            if lift is not None:
                cabin, occupant = self._truth.elevator(lift)
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
                with self._truth.change():
                    middle = _between(step.approach or step.leave, step.leave, 0.6)
                    self._truth.put_robot(self.name, step.to_place, middle)
                    self._truth.carry(self.name, step.to_place)
                    self._truth.log(self.name, "passed", name)
                    if lift is not None:
                        cabin = self._truth.elevator(lift)[0]
                        inside = cabin == step.to_place
                        self._truth.log(self.name, "entered" if inside else "left", lift)
                        self._truth.set_elevator(lift, cabin, self.name if inside else None)
                        self._truth.set_door(name, "ajar")
        with self._truth.change():
            self._truth.put_robot(self.name, step.to_place, step.leave)
            if self._truth.door(name) == "ajar" and lift is None:
                self._truth.set_door(name, "closed")  # left as it was
        return None, ""

    def _call(self, stage: Stage) -> _Work:
        step, name = stage.step, self._connector(stage)
        assert step is not None
        lift = str(step.elevator)
        at = yield stage.seconds
        while at < stage.seconds:
            at = yield stage.seconds
        while True:
            with self._truth.change():
                if not self._stands_at(stage):
                    return self._misplaced(stage)
                if self._fails("call_elevator"):
                    return "absent", f"{lift} does not come"
                _, occupant = self._truth.elevator(lift)
                if occupant in (None, self.name):
                    self._truth.set_elevator(lift, self._cabin_doors[lift][name], None)
                    self._truth.set_door(name, "ajar")
                    self._truth.log(self.name, "called", lift)
                    return None, ""
            if at >= stage.seconds + self._wait:
                return "absent", f"{lift} does not come: {occupant} is in it"
            at = yield at

    def _ride(self, stage: Stage) -> _Work:
        step = stage.step
        assert step is not None
        lift = str(step.elevator)
        with self._truth.change():
            place, _ = self._truth.robot(self.name)
            if place != step.from_place or self._truth.elevator(lift)[0] != place:
                return self._misplaced(stage)
            if self._fails("use_elevator"):
                return "absent", f"{lift} does not leave"
        while (yield stage.seconds) < stage.seconds:
            pass
        with self._truth.change():
            self._truth.set_elevator(lift, step.to_place, self.name)
            for name, cabin in self._cabin_doors[lift].items():
                if cabin == step.to_place:
                    self._truth.set_door(name, "ajar")
            self._truth.put_robot(self.name, step.to_place, step.leave)
            self._truth.carry(self.name, step.to_place)
            self._truth.log(self.name, "rode", lift)
        return None, ""

    def _take(self, stage: Stage) -> _Work:
        thing = stage.arguments[0]
        while (yield stage.seconds) < stage.seconds / 2:
            pass
        with self._truth.change():
            place, pose = self._truth.robot(self.name)
            there, seen = self._truth.things().get(thing, ("", None))
            if seen is None or there != place or self._truth.has_robot(seen.holder):
                return "gone", f"{thing} is not there"
            if math.dist((pose.x, pose.y), (seen.pose.x, seen.pose.y)) > REACH:
                return "misplaced", f"{thing} is out of reach"
            if self._fails("pickup"):
                return "missed", f"the grasp of {thing} failed"
            self._truth.put_thing(thing, place, Seen(self.name, "in", GRIP))
            self._truth.log(self.name, "took", thing)
        while (yield stage.seconds) < stage.seconds:
            pass
        return None, ""

    def _put(self, stage: Stage) -> _Work:
        thing, target = stage.arguments[0], stage.arguments[-1]
        assert stage.spot is not None
        while (yield stage.seconds) < stage.seconds / 2:
            pass
        with self._truth.change():
            place, _ = self._truth.robot(self.name)
            _, seen = self._truth.things().get(thing, ("", None))
            if seen is None or seen.holder != self.name:
                return "gone", f"{thing} is not in its gripper"
            if self._fails("place"):
                return self._drop(place)
            relation = "in" if target == place else "on"
            self._truth.put_thing(thing, place, Seen(target, relation, stage.spot))  # type: ignore[arg-type]
            self._truth.log(self.name, "put", thing)
        while (yield stage.seconds) < stage.seconds:
            pass
        return None, ""

    # -- what they share ------------------------------------------------------------------------

    def _switch(self, stage: Stage) -> _Work:
        while (yield stage.seconds) < stage.seconds:
            pass
        if self._fails("switch_map"):
            return "unable", "the map is not there"
        return None, ""

    def _fails(self, what: str) -> bool:
        return self._truth.fails(self.name, what, self._seed)

    def _stands_at(self, stage: Stage) -> bool:
        place, pose = self._truth.robot(self.name)
        return stage.begins(place, pose)

    def _misplaced(self, stage: Stage) -> tuple[Cause, str]:
        place, pose = self._truth.robot(self.name)
        return "misplaced", f"{stage} does not begin in {place} at ({pose.x:.2f}, {pose.y:.2f})"

    def _connector(self, stage: Stage) -> str:
        assert stage.step is not None
        assert stage.step.connector is not None
        return stage.step.connector.name


class _Doing:
    """A behaviour of the simulated robot at work."""

    def __init__(self, robot: SimulatedRobot, work: _Work) -> None:
        self._robot = robot
        self._work = work
        self._since = time.monotonic()
        self._seconds: float | None = None

    def poll(self) -> Outcome | None:
        """How it ended; None while it works."""
        at = (time.monotonic() - self._since) * self._robot.speed
        try:
            if self._seconds is None:
                self._seconds = next(self._work)
            self._seconds = self._work.send(at)
        except StopIteration as end:
            cause, said = end.value
            return Outcome(cause, said, min(at, self._seconds or 0.0))
        return None

    def cancel(self) -> None:
        """Stop where it is."""
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
