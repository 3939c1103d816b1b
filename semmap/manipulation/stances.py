"""Where a robot stands so that its arm gets along an action: inverse reachability.

The base is level and moves with the arm while inverse kinematics is solved, so that an arm with few
joints gets to a grasp, too (Vahrenkamp et al., "Robot placement based on reachability inversion",
2013). Obstacles do not count here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.arrays import Floats
from semmap.geometry.pose import Pose
from semmap.manipulation.arm import Arm
from semmap.manipulation.extra import library, mujoco_pose
from semmap.manipulation.joint_steps import joint_step, limits_of

STARTS = 16
"""Random positions of the arm from which stances along a way are found."""

ITERATIONS = 60
POSITION, ROTATION = 1e-4, 1e-3
"""The largest error, metres and radians: less than that of `Arm.reach`, which is asked next."""

ALIKE = 4
"""Decimals of metres and of axes within which ways are the same."""

PLANAR = 3
"""Directions in which a base moves: x, y and its heading."""


class Stances:
    """The stances of an arm along ways of its gripper, each way found once."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._found: dict[tuple[Any, ...], list[Floats]] = {}
        self._models: dict[int, Any] = {}

    def bases(
        self, ways: Sequence[Sequence[Floats]], floor: float
    ) -> tuple[Floats, NDArray[np.intp]]:
        """(N, 3) x, y and yaw of bases on a floor, and (N,) the number of the way of each.

        A way is the poses (4, 4) of the grasp frame that the arm takes from one base, map's frame.
        """
        bases, which = [np.empty((0, 3))], [np.empty(0, np.intp)]
        for number, way in enumerate(ways):
            found = self.along(way, floor)
            bases.append(np.array([(p.x, p.y, p.yaw) for p in found]).reshape(-1, 3))
            which.append(np.full(len(found), number))
        return np.concatenate(bases), np.concatenate(which)

    def along(self, way: Sequence[Floats], floor: float) -> list[Pose]:
        """Bases on a floor from which the arm gets along a way, map's frame."""
        ground = ground_of(way[0], floor)
        return [Pose.from_matrix(ground @ base) for base in self._relative(way, ground)]

    def grounds(self, way: Sequence[Floats], floor: float) -> list[Floats]:
        """The ground frames (4, 4) of the first pose of such a way, in the frame of the robot."""
        ground = ground_of(way[0], floor)
        return [_inverse(base) for base in self._relative(way, ground)]

    def _relative(self, way: Sequence[Floats], ground: Floats) -> list[Floats]:
        """Bases (4, 4) in the ground frame of a way."""
        goals = _inverse(ground) @ np.array(way)
        key = (len(way), *goals[:, :3].round(ALIKE).ravel().tolist())
        if key not in self._found:
            self._found[key] = self._solved(goals)
        return self._found[key]

    def _solved(self, goals: Floats) -> list[Floats]:
        """Bases (4, 4) from which the arm gets to all goals, in the frame of these."""
        mink = library("mink")
        model = self._models.setdefault(len(goals), self._model(len(goals)))
        configuration, limits = mink.Configuration(model), limits_of(model)
        tasks = []
        for number, goal in enumerate(goals):
            name = f"grasp {number}" if number else "grasp"
            task = mink.FrameTask(name, "site", position_cost=1.0, orientation_cost=0.5)
            task.set_target(mink.SE3.from_matrix(goal))
            tasks.append(task)
        random, found = np.random.default_rng(0), []
        low, high = self._arm.low, self._arm.high
        for position in random.uniform(low, high, (STARTS, len(low))):
            base = self._first(position, goals[0])
            configuration.update(np.concatenate([base, np.tile(position, len(goals))]))
            if self._converges(configuration, tasks, limits):
                x, y, yaw = configuration.q[:PLANAR].tolist()
                found.append(Pose.planar(x, y, yaw).matrix)
        return found

    def _first(self, position: Floats, goal: Floats) -> Floats:
        """The level base (x, y, yaw) from which a position is nearest to a goal (4, 4)."""
        pose = self._arm.grasp_pose(position)
        turn = goal[:2, :3] @ pose[:2, :3].T
        yaw = math.atan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
        cos, sin = math.cos(yaw), math.sin(yaw)
        x, y = goal[:2, 3] - np.array([[cos, -sin], [sin, cos]]) @ pose[:2, 3]
        return np.array([x, y, yaw])

    @staticmethod
    def _converges(configuration: Any, tasks: list[Any], limits: tuple[Floats, Floats]) -> bool:
        best, stuck = np.inf, 0
        for _ in range(ITERATIONS):
            errors = np.array([task.compute_error(configuration) for task in tasks])
            if (np.linalg.norm(errors[:, :3], axis=1) < POSITION).all() and (
                np.linalg.norm(errors[:, 3:], axis=1) < ROTATION
            ).all():
                return True
            size = float(np.linalg.norm(errors))
            stuck = stuck + 1 if size > 0.95 * best else 0
            best = min(best, size)
            if stuck > 5:
                return False
            configuration.integrate_inplace(joint_step(configuration, tasks, limits), 1.0)
        return False

    def _model(self, copies: int) -> Any:
        """The base, which moves on the ground, and on it the arm once for each pose of a way."""
        mujoco = library("mujoco")
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
        base = spec.worldbody.add_body(name="level base")
        base.explicitinertial, base.mass, base.inertia = True, 1.0, [0.01] * 3
        for name, kind, axis in (
            ("level x", slide, (1, 0, 0)),
            ("level y", slide, (0, 1, 0)),
            ("level yaw", hinge, (0, 0, 1)),
        ):
            base.add_joint(name=name, type=kind, axis=axis)
        root = base.add_body(name="root of arms", **mujoco_pose(self._arm.root))
        for number in range(copies):
            self._arm.add_to(root, number)
        return spec.compile()


def _inverse(pose: Floats) -> Floats:
    found: Floats = np.asarray(np.linalg.inv(pose), np.float64)
    return found


def ground_of(pose: Floats, floor: float) -> Floats:
    """The frame (4, 4) on the floor below a pose (4, 4), turned as its approach is."""
    ahead = pose[:2, 2] if np.linalg.norm(pose[:2, 2]) > 0.1 else pose[:2, 0]
    x, y = pose[:2, 3].tolist()
    ground: Floats = Pose.planar(x, y, math.atan2(ahead[1], ahead[0]), floor).matrix
    return ground
