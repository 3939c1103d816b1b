"""Motions of an arm that touch nothing (Tosello et al., section IV-B)."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from semmap.arrays import Floats
from semmap.manipulation.arm import Arm
from semmap.manipulation.collision import ConvexBody, Obstacles, PlacedObstacles
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.extra import library

STEP = 0.05
"""The largest change of a joint between checked positions, radians or metres."""


RANGE = 0.5
"""The longest motion by which KPIECE extends its tree, radians: OMPL's default is too long."""

POSTURES = 3
"""Postures of the arm that are tried for a grasp."""


class Held(NamedTuple):
    """An object in the gripper, which is a part of the robot during transport."""

    body: ConvexBody

    pose: Floats
    """(4, 4) in the grasp frame."""

    width: float
    """Metres between the pads."""

    led: bool = False
    """It moves on a joint of its own: what it touches beside the robot does not matter."""


class Stroke(NamedTuple):
    """A move of the gripper, straight unless it leads `through` other poses.

    The first one of several is any free motion instead.
    """

    pose: Floats
    """(4, 4) of the grasp frame at its end, in the robot's frame."""

    obstacles: Obstacles | PlacedObstacles
    """In the robot's frame: obstacles that must not be touched meanwhile."""

    fingers: Mapping[str, float] | None = None
    """Positions of the finger joints; by default open, or around the object that is held."""

    held: Held | None = None

    through: Floats | None = None
    """(K, 4, 4) poses of the grasp frame, near each other, of which the last one is `pose`."""


def plan_motion(
    arm: Arm, start: Floats, goal: Floats, stroke: Stroke, seconds: float = 5.0
) -> Floats | None:
    """Positions (N, D) from start to goal (D,) that are free of collisions; None if not found.

    Of several goals (G, D), to that which is found first: some are much easier to reach.
    RRT-Connect (Kuffner and LaValle) of OMPL for three quarters of the seconds of the processor,
    then KPIECE (Şucan and Kavraki), then shortcuts; each position has been checked, and a joint
    moves by at most `STEP` between them. ManipulationError where start or a goal touches something
    or is beyond limits.
    """
    goals = np.atleast_2d(goal)

    def free(position: Floats) -> bool:
        return is_free(arm, position, stroke)

    for name, position in (("start", start), *(("goal", each) for each in goals)):
        beyond = (position < arm.low - 1e-9) | (position > arm.high + 1e-9)
        if beyond.any():
            joint = arm.joints[int(np.argmax(beyond))].name
            raise ManipulationError(f"{name} of the motion: joint {joint} is beyond its limits")
        if not free(position):
            raise ManipulationError(
                f"{name} of the motion: the arm touches an obstacle or itself; choose another"
            )
    for each in goals:
        steps = math.ceil(float(np.abs(each - start).max()) / STEP)
        direct = np.linspace(start, each, max(steps, 1) + 1)
        if all(free(p) for p in direct):
            return direct
    return _planned(arm, start, goals, free, seconds)


def is_free(arm: Arm, position: Floats, stroke: Stroke) -> bool:
    """Whether the arm, with what it holds, touches nothing at a position (D,)."""
    held, fingers = stroke.held, stroke.fingers
    if fingers is None and held is not None:
        fingers = arm.gripper.posture(held.width)
    item = None if held is None else (held.body, held.pose)
    led = held is not None and held.led
    return arm.is_free(position, stroke.obstacles, fingers=fingers, held=item, led=led)


def _planned(arm: Arm, start: Floats, goals: Floats, is_free: Any, seconds: float) -> Floats | None:
    base, geometric, util = (library(f"ompl.{name}") for name in ("base", "geometric", "util"))
    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(1)
    count = len(start)
    space = base.RealVectorStateSpace(count)
    bounds = base.RealVectorBounds(count)
    for i in range(count):
        bounds.setLow(i, float(arm.low[i]))
        bounds.setHigh(i, float(arm.high[i]))
    space.setBounds(bounds)
    space.setLongestValidSegmentFraction(STEP / max(space.getMaximumExtent(), STEP))
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: is_free(np.array([state[i] for i in range(count)])))
    ends = base.GoalStates(setup.getSpaceInformation())
    for add, position in ((setup.addStartState, start), *((ends.addState, each) for each in goals)):
        state = space.allocState()
        for i in range(count):
            state[i] = float(position[i])
        add(state)
    setup.setGoal(ends)
    kpiece = geometric.KPIECE1(setup.getSpaceInformation())
    kpiece.setRange(RANGE)
    connect = geometric.RRTConnect(setup.getSpaceInformation())
    for planner, share in ((connect, 0.75), (kpiece, 0.25)):
        setup.setPlanner(planner)
        end = time.process_time() + share * seconds
        late = base.PlannerTerminationCondition(lambda end=end: time.process_time() > end)
        if setup.solve(late) and setup.haveExactSolutionPath():
            break
    else:
        return None
    setup.simplifySolution(min(1.0, seconds / 5))
    found = setup.getSolutionPath()
    found.interpolate()  # to the very states that the planner checked
    path = np.array([[s[i] for i in range(count)] for s in found.getStates()])
    return path if all(is_free(p) for p in path) else None


def straight_motion(arm: Arm, start: Floats, pose: Floats) -> Floats | None:
    """Positions (N, D) that move the gripper straight to a pose (4, 4) without turning it."""
    begin = arm.grasp_pose(start)
    between = np.tile(pose, (10, 1, 1))
    shares = np.linspace(0, 1, 11)[1:, None]
    between[:, :3, 3] = (1 - shares) * begin[:3, 3] + shares * pose[:3, 3]
    return led_motion(arm, start, between)


def led_motion(arm: Arm, start: Floats, poses: Floats) -> Floats | None:
    """Positions (N, D) that move the gripper through poses (K, 4, 4), the start before them."""
    found = [start]
    for pose in poses:
        position = arm.reach(pose, found[-1], starts=1)
        if position is None or np.abs(position - found[-1]).max() > 0.5:
            return None
        found.append(position)
    return np.array(found)


def straight_motions(arm: Arm, start: Floats, strokes: Sequence[Stroke]) -> list[Floats] | None:
    """The positions (N, D) of each of some strokes from a start (D,); None if one is not free."""
    found: list[Floats] = []
    for stroke in strokes:
        if stroke.through is None:
            moved = straight_motion(arm, start, stroke.pose)
        else:
            moved = led_motion(arm, start, stroke.through)
        if moved is None or not all(is_free(arm, p, stroke) for p in moved):
            return None
        found.append(moved)
        start = moved[-1]
    return found


def free_strokes(
    arm: Arm, start: Floats, strokes: Sequence[Stroke]
) -> Iterator[tuple[Floats, list[Floats]]]:
    """Postures in which strokes are free: the end (D,) of the first, (N, D) of each other one."""
    first, *others = strokes
    for seed in range(POSTURES):
        before = arm.reach(first.pose, start if seed == 0 else None, seed=seed)
        if before is None:
            return
        if is_free(arm, before, first):
            after = straight_motions(arm, before, others)
            if after is not None:
                yield before, after
