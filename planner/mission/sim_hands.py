"""How a simulated robot takes objects, and puts them down."""

from __future__ import annotations

import math

from planner.mission.behaviours import Cause, Sighting
from planner.mission.command import Command
from planner.mission.sim_body import SimBody, Work, lasting
from semmap.geometry.pose import Pose

GRIP = Pose(0.3, 0.0, 0.8)
"""Pose of a held object, in the robot's frame."""

REACH = 1.5
"""Metres from the robot's base to the objects that it takes."""


def pickup(body: SimBody, command: Command) -> Work:
    """Take the object from its true place."""
    item, world = command.arguments[0], body.world
    yield from _half_of(command)
    with world.change():
        missing = _not_in_reach(body, item)
        if missing is not None:
            return missing
        if body.fails("pickup"):
            return "missed", f"the grasp of {item} failed"
        here, _ = world.robot(body.name)
        world.put_object(item, here, Sighting(body.name, "in", GRIP))
        world.log(body.name, "took", item)
    yield from lasting(command.seconds)
    return None, ""


def _not_in_reach(body: SimBody, item: str) -> tuple[Cause, str] | None:
    here, pose = body.world.robot(body.name)
    there, seen = body.world.objects().get(item, ("", None))
    if seen is None or there != here or body.world.has_robot(seen.holder):
        return "gone", f"{item} is not there"
    if math.dist((pose.x, pose.y), (seen.pose.x, seen.pose.y)) > REACH:
        return "misplaced", f"{item} is out of reach"
    return None


def place(body: SimBody, command: Command) -> Work:
    """Put the object down at `command.spot`."""
    item, target, world = command.arguments[0], command.arguments[-1], body.world
    assert command.spot is not None
    yield from _half_of(command)
    with world.change():
        here, _ = world.robot(body.name)
        _, seen = world.objects().get(item, ("", None))
        if seen is None or seen.holder != body.name:
            return "gone", f"{item} is not in its gripper"
        if body.fails("place"):
            return drop(body, here)
        sighting = Sighting(target, "in" if target == here else "on", command.spot)
        world.put_object(item, here, sighting)
        world.log(body.name, "put", item)
    yield from lasting(command.seconds)
    return None, ""


def drop(body: SimBody, place: str) -> tuple[Cause, str]:
    """Let all objects fall in front of the robot."""
    _, pose = body.world.robot(body.name)
    dropped = held_objects(body)
    for name in dropped:
        ahead = pose @ Pose(0.4, 0.0, 0.0)
        body.world.put_object(name, place, Sighting(place, "in", ahead))
        body.world.log(body.name, "dropped", name)
    return "dropped", f"{', '.join(dropped)} fell down in {place}"


def held_objects(body: SimBody) -> list[str]:
    """The names of the objects that the robot holds."""
    return [n for n, (_, seen) in body.world.objects().items() if seen.holder == body.name]


def _half_of(command: Command) -> Work:
    while (yield command.seconds) < command.seconds / 2:
        pass
    return None, ""
