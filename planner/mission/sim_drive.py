"""How a simulated robot drives inside a place, and changes its map."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.mission.command import Command
from planner.mission.sim_body import SimBody, Work, lasting
from planner.mission.sim_hands import drop, held_objects
from semmap.geometry.pose import Pose


def navigate(body: SimBody, command: Command) -> Work:
    """Drive along a path, on the costmap if there is one."""
    step = command.step
    assert step is not None
    place, pose = body.world.robot(body.name)
    if place != step.from_place:
        return body.misplaced(command)
    points = body.path(place, pose, step.leave)
    if points is None:
        return "blocked", f"no path leads there in {place}"
    fails = body.fails("navigate")
    drops = bool(held_objects(body)) and body.fails("drop")
    seconds = sum(math.dist(a, b) for a, b in pairwise(points)) / body.velocity
    at = 0.0
    while at < seconds:
        at = min((yield seconds), seconds)
        share = at / seconds
        if (fails or drops) and share >= 0.5:
            with body.world.change():
                body.world.put_robot(body.name, place, _along(points, 0.5, pose))
                if drops:
                    return drop(body, place)
            return "blocked", f"something stands in the way in {place}"
        there = step.leave if share >= 1 else _along(points, share, pose)
        body.world.put_robot(body.name, place, there)
    body.world.put_robot(body.name, place, step.leave)
    return None, ""


def switch_map(body: SimBody, command: Command) -> Work:
    """Switch at once."""
    yield from lasting(command.seconds)
    if body.fails("switch_map"):
        return "unable", "the map is not there"
    return None, ""


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
