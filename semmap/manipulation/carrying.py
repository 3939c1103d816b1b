"""The posture in which arms are carried through doors: near the axis of their robot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress

import numpy as np

from semmap.arrays import Floats
from semmap.manipulation.arm import Arm
from semmap.manipulation.collision import Obstacles, convex_body
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.gripper_reader import find_grippers

DRAWN = 1000
"""Random postures that are considered, beside that at rest."""

FLOOR = 0.05
"""Metres above the floor that all of the arm stays."""

ROOM = (0.12, 0.08, 0.04)
"""Radii of balls for which there is room in the gripper, if possible for the first, metres."""


def folded_posture(first: Gripper) -> dict[str, float]:
    """The `carrying_posture` of a gripper's arm, and of each other arm of its robot beside it."""
    posture: dict[str, float] = {}
    others = (each for each in find_grippers(first.robot) if each.palm != first.palm)
    for gripper in (first, *others):
        with suppress(ManipulationError):  # no joint moves it
            posture |= carrying_posture(Arm(gripper, posture))
    return posture


def carrying_posture(arm: Arm) -> dict[str, float]:
    """Positions of an arm's joints with which a robot can drive, by name, radians or metres.

    Of random postures in which the arm, with a large ball in its gripper, touches nothing of the
    robot, the one nearest to the robot's vertical axis; with a smaller ball where all touch
    something, and at last at rest. Joints that the state of the arm has stay there.
    """
    random = np.random.default_rng(0)
    drawn = random.uniform(arm.low, arm.high, (DRAWN, len(arm.low)))
    held = [i for i, joint in enumerate(arm.joints) if joint.name in arm.state]
    drawn[:, held] = arm.rest()[held]
    some = [arm.rest(), *drawn]
    balls = [_ball(max(radius, arm.gripper.opening / 2)) for radius in ROOM]
    free = (posture for ball in balls for posture in _free_with(arm, some, ball))
    chosen = next(free, arm.rest())
    return dict(zip((j.name for j in arm.joints), chosen.round(4).tolist(), strict=True))


def _free_with(arm: Arm, postures: Sequence[Floats], ball: Floats) -> Iterator[Floats]:
    """The postures in which an arm with a ball touches nothing, the nearest to the axis first."""
    nothing, held = Obstacles(np.empty((0, 3, 3))), (convex_body(ball), np.eye(4))
    away = np.array([_reach(arm, posture, ball) for posture in postures])
    for number in np.argsort(away, kind="stable"):
        if np.isfinite(away[number]) and arm.is_free(postures[number], nothing, held=held):
            yield postures[number]


def _ball(radius: float) -> Floats:
    """Corners (N, 3) of a ball in front of the palm, in the grasp frame."""
    signs = np.array(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3)).reshape(3, -1).T
    directions = signs[signs.any(axis=1)]
    corners: Floats = radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return corners


def _reach(arm: Arm, posture: Floats, ball: Floats) -> float:
    """How far from the axis an arm and a ball are, metres; infinite where they are too low."""
    pose = arm.grasp_pose(posture)
    held = ball @ pose[:3, :3].T + pose[:3, 3]
    corners = np.concatenate([arm.corners(posture), held])
    if corners[:, 2].min() < FLOOR:
        return float("inf")
    return float(np.hypot(corners[:, 0], corners[:, 1]).max())
