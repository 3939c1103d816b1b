"""Arms: forward and inverse kinematics from a robot's base to its gripper, and their collisions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache, cached_property
from itertools import combinations
from threading import local
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.arrays import Floats
from semmap.manipulation.collision import (
    ConvexBody,
    Obstacles,
    PlacedObstacles,
    convex_body,
    placed,
    touch,
)
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.extra import library, mujoco_pose
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.joint_steps import joint_step, limits_of
from semmap.robot.urdf import Joint

POSITION, ROTATION = 5e-4, 5e-3
"""The largest error of a solution, metres and radians."""

ITERATIONS = 60
STARTS = 16
"""Iterations of one attempt of inverse kinematics, and attempts from different positions."""


TURNING, SLIDING = 1.0, 0.1
"""Radians and metres a second that joints move at most: near people, robots stay below limits."""

FREEDOMS = 6
"""Directions in which a body moves and turns."""


_Attached = tuple[Floats, dict[int, ConvexBody]]
"""What `Arm._attachment` returns."""


class Arm:
    """The joints from a robot's base to a gripper; all others are as `state` says, else at rest.

    `joints` are those that move, from the base on; `low` and `high` (D,) their limits, radians or
    metres, half a turn to each side of continuous ones. ManipulationError where there is none.
    """

    def __init__(self, gripper: Gripper, state: Mapping[str, float] | None = None) -> None:
        robot = gripper.robot
        self.gripper, self.robot = gripper, robot
        self.state = dict(state or {})
        above = {joint.child: joint for joint in robot.joints}
        chain: list[Joint] = []
        link = gripper.palm
        while link in above:
            chain.append(above[link])
            link = above[link].parent
        self._chain = [joint.child for joint in chain]
        self.joints = tuple(
            j
            for j in reversed(chain)
            if j.type in ("revolute", "continuous", "prismatic") and j.mimics is None
        )
        if not self.joints:
            raise ManipulationError(
                f"{robot.name}: no joint moves {gripper.palm}; give the URDF of a whole robot"
            )
        limits = np.array([j.limits for j in self.joints])
        self.low = np.where(np.isfinite(limits[:, 0]), limits[:, 0], -np.pi)
        self.high = np.where(np.isfinite(limits[:, 1]), limits[:, 1], np.pi)
        self.root = robot.link_poses({}, [robot.links[0]])[robot.links[0]]
        # Constant transforms: to each joint from the one before, and to the tool from the last.
        before, fixed = [], np.eye(4)
        for joint in reversed(chain):
            moves = joint in self.joints
            fixed = fixed @ robot.transform(joint, {} if moves else self.state)
            if moves:
                before.append(fixed)
                fixed = np.eye(4)
        self._before = np.array(before)
        self._tool = fixed @ gripper.frame
        carrier = {robot.links[0]: 0}
        for joint in robot.joints:
            number = self.joints.index(joint) + 1 if joint in self.joints else None
            carrier[joint.child] = carrier[joint.parent] if number is None else number
        margins = gripper.margins
        self._links = tuple(link for link in robot.meshes if link not in margins)
        self._carrier = np.array([carrier[link] for link in self._links])
        self._attached: dict[tuple[tuple[str, float], ...], _Attached] = {}
        self._bodies = [convex_body(robot.hull(link)) for link in self._links]
        self._moved = local()

    def rest(self) -> Floats:
        """The position (D,) of the joints at rest, within their limits."""
        given = [self.state.get(j.name, 0.0) for j in self.joints]
        return np.clip(given, self.low, self.high)

    def position(self, named: Mapping[str, float]) -> Floats:
        """The position (D,) where the joints are as `named`; KeyError without one of them."""
        return np.array([named[joint.name] for joint in self.joints])

    def seconds(self, start: Floats, end: Floats) -> float:
        """How long the joint takes that moves longest from one position (D,) straight to another.

        A motion around obstacles takes longer.
        """
        return float((np.abs(end - start) / self._speeds).max())

    @cached_property
    def _speeds(self) -> Floats:
        usual = np.where(self._axes[0], SLIDING, TURNING)
        return np.minimum(usual, [joint.velocity for joint in self.joints])

    def grasp_pose(self, position: Floats) -> Floats:
        """The pose (4, 4) of the grasp frame in the robot's frame."""
        pose: Floats = self._frames(position)[-1] @ self._tool
        return pose

    def corners(self, position: Floats) -> Floats:
        """The corners (N, 3) of the hulls of the arm and its gripper, robot's frame."""
        poses = self._link_poses(position)
        own = {*self._chain, *self.gripper.links}
        found: Floats = np.concatenate(
            [
                self.robot.hull(link) @ poses[i, :3, :3].T + poses[i, :3, 3]
                for i, link in enumerate(self._links)
                if link in own and self._carrier[i]
            ]
        )
        return found

    def _frames(self, position: Floats) -> Floats:
        """(D + 1, 4, 4): the frames of the fixed links and behind each joint, robot's frame."""
        frames = np.empty((len(self.joints) + 1, 4, 4))
        frames[0] = self.root
        for i, moved in enumerate(self._before @ self._moves(np.asarray(position))):
            frames[i + 1] = frames[i] @ moved
        return frames

    def _moves(self, position: Floats) -> Floats:
        """(D, 4, 4): the motion of each joint; turns are those of Rodrigues."""
        slides, shifts, cross, twice = self._axes
        angles = np.where(slides, 0.0, position)[:, None, None]
        moves = np.zeros((len(position), 4, 4))
        moves[:, :3, 3] = shifts * position[:, None]
        moves[:, :3, :3] = np.eye(3) + np.sin(angles) * cross + (1 - np.cos(angles)) * twice
        moves[:, 3, 3] = 1
        return moves

    @cached_property
    def _axes(self) -> tuple[NDArray[np.bool_], Floats, Floats, Floats]:
        """Which joints slide, (D, 3) along what, and (D, 3, 3) cross products, once and twice.

        Those are with the axes of turns.
        """
        slides = np.array([joint.type == "prismatic" for joint in self.joints])
        axes = np.array([joint.axis for joint in self.joints], float)
        units = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        cross = np.cross(units[:, None], -np.eye(3))
        return slides, axes * slides[:, None], cross, cross @ cross

    def _link_poses(self, position: Floats) -> Floats:
        poses: Floats = self._frames(position)[self._carrier] @ self._attachment(None)[0]
        return poses

    def _attachment(self, fingers: Mapping[str, float] | None) -> _Attached:
        """What each joint carries while the fingers, by default open, keep their positions.

        (L, 4, 4) poses of links in the frame of their joint, and by joint the hull of its links.
        """
        posture = tuple(sorted((fingers or self.gripper.postures[0]).items()))
        if posture not in self._attached:
            poses = self._poses_of_links(dict(posture))
            hulls = {}
            for joint in set(self._carrier.tolist()) - {0}:
                corners = [
                    self.robot.hull(self._links[i]) @ poses[i, :3, :3].T + poses[i, :3, 3]
                    for i in np.flatnonzero(self._carrier == joint)
                ]
                hulls[joint] = convex_body(np.concatenate(corners))
            self._attached[posture] = poses, hulls
        return self._attached[posture]

    def _poses_of_links(self, fingers: Mapping[str, float]) -> Floats:
        state = {**self.state, **fingers}
        rest = self.rest()
        state.update(zip((j.name for j in self.joints), rest.tolist(), strict=True))
        found = {self.robot.links[0]: self.root}
        for joint in self.robot.joints:
            found[joint.child] = found[joint.parent] @ self.robot.transform(joint, state)
        frames = self._frames(rest)
        return np.array(
            [
                np.linalg.inv(frames[carrier]) @ found[link]
                for link, carrier in zip(self._links, self._carrier, strict=True)
            ]
        )

    @cached_property
    def span(self) -> tuple[Floats, float]:
        """The first joint, (3,) in the robot's frame, and the length of the stretched arm."""
        length = float(np.linalg.norm(self._tool[:3, 3]))
        length += sum(float(np.linalg.norm(before[:3, 3])) for before in self._before[1:])
        slides = self._axes[0]
        length += float(np.maximum(np.abs(self.low), np.abs(self.high))[slides].sum())
        return (self.root @ self._before[0])[:3, 3], length

    @cached_property
    def reaches_towards(self) -> tuple[float, float]:
        """The direction (x, y), robot's frame, in which the grasp frame mostly is."""
        x, y = np.median(self._drawn, axis=0)
        return float(x), float(y)

    @cached_property
    def usual_reach(self) -> float:
        """The median distance of the grasp frame from the robot's axis, metres."""
        return float(np.median(np.linalg.norm(self._drawn, axis=1)))

    @cached_property
    def _drawn(self) -> Floats:
        """(200, 2) x, y of the grasp frame, robot's frame, at random positions."""
        random = np.random.default_rng(0)
        drawn = random.uniform(self.low, self.high, (200, len(self.low)))
        return np.array([self.grasp_pose(position)[:2, 3] for position in drawn])

    @cached_property
    def needs_base(self) -> bool:
        """Whether it lacks joints to bring the gripper to any pose near another one.

        From a base that is given, it then gets to a grasp by chance alone.
        """
        random, step, ranks = np.random.default_rng(0), 1e-5, []
        for position in random.uniform(self.low, self.high, (5, len(self.low))):
            here = self.grasp_pose(position)
            moved = [self.grasp_pose(position + row) for row in step * np.eye(len(position))]
            columns = [((pose - here)[:3] / step).ravel() for pose in moved]
            ranks.append(np.linalg.matrix_rank(np.array(columns), tol=1e-3))
        return int(max(ranks)) < FREEDOMS

    def is_far(self, points: Floats) -> NDArray[np.bool_]:
        """Whether points (..., 3) in the robot's frame are beyond the stretched arm."""
        shoulder, length = self.span
        far: NDArray[np.bool_] = np.linalg.norm(points - shoulder, axis=-1) > length
        return far

    def reaches_point(self, point: Floats, starts: int = STARTS) -> bool:
        """Whether the grasp frame gets to a point (3,) in the robot's frame, turned in any way."""
        pose = np.eye(4)
        pose[:3, 3] = point
        return self.reach(pose, starts=starts, turned=False) is not None

    def reach(
        self,
        pose: Floats,
        near: Floats | None = None,
        *,
        starts: int = STARTS,
        seed: int = 0,
        turned: bool = True,
    ) -> Floats | None:
        """A position (D,) that brings the grasp frame to a pose (4, 4), robot's frame; else None.

        Differential inverse kinematics of mink (a quadratic program with the joints' limits), from
        `near` (D,), by default at rest, then from random positions. Unless `turned`, the frame only
        gets to the point of the pose.
        """
        mink = library("mink")
        goal = np.linalg.inv(self.root) @ pose
        random = np.random.default_rng(seed)
        target = mink.SE3.from_matrix(goal)
        cost, axes = (0.5, 6) if turned else (0.0, 3)
        task = mink.FrameTask("grasp", "site", position_cost=1.0, orientation_cost=cost)
        task.set_target(target)
        configuration, limits = self._configuration()
        for attempt in range(starts):
            if attempt == 0 and (near is not None or seed == 0):
                begin = self.rest() if near is None else near
            else:
                begin = random.uniform(self.low, self.high)
            configuration.update(np.clip(begin, self.low, self.high))
            best, stuck = np.inf, 0
            for _ in range(ITERATIONS):
                error = task.compute_error(configuration)[:axes]
                size = float(np.linalg.norm(error))
                stuck = stuck + 1 if size > 0.95 * best else 0
                best = min(best, size)
                if stuck > 5:
                    break
                if np.linalg.norm(error[:3]) < POSITION and np.linalg.norm(error[3:]) < ROTATION:
                    found: Floats = np.clip(configuration.q, self.low, self.high)
                    return found
                configuration.integrate_inplace(joint_step(configuration, [task], limits), 1.0)
        return None

    def is_free(
        self,
        position: Floats,
        obstacles: Obstacles | PlacedObstacles,
        *,
        fingers: Mapping[str, float] | None = None,
        held: tuple[ConvexBody, Floats] | None = None,
        led: bool = False,
    ) -> bool:
        """Whether no moving link touches an obstacle, in the robot's frame, or another link.

        `fingers` are by default open. `held` is a part of the robot: a body and its pose (4,
        4) in the grasp frame. What is `led` on a joint of its own may touch obstacles.
        """
        attached, hulls = self._attachment(fingers)
        frames = self._frames(position)
        poses: Floats = frames[self._carrier] @ attached
        near = [k for k, hull in hulls.items() if obstacles.touched_by([hull], [frames[k]])]
        moving = np.flatnonzero(np.isin(self._carrier, near))
        if obstacles.touched_by([self._bodies[i] for i in moving], [*poses[moving]]):
            return False
        if any(True for _ in self._touching(poses, self._pairs)):
            return False
        if held is None:
            return True
        body, there = held[0], frames[-1] @ self._tool @ held[1]
        if not led and obstacles.touched_by([body], [there]):
            return False
        poses = np.concatenate([poses, [there]])
        return not any(True for _ in self._touching(poses, self._others, body))

    def _touching(
        self, poses: Floats, pairs: NDArray[np.intp], held: ConvexBody | None = None
    ) -> Iterator[int]:
        """Which of (P, 2) pairs of links touch; what is held comes after the links."""
        bodies, boxes = self._bodies, self._boxes
        if held is not None:
            bodies = [*bodies, held]
            boxes = np.concatenate([boxes, [[held.middle], [held.half]]], axis=1)
        turns = poses[:, :3, :3]
        middles = np.einsum("lij,lj->li", turns, boxes[0]) + poses[:, :3, 3]
        halves = np.einsum("lij,lj->li", np.abs(turns), boxes[1])
        a, b = pairs.T
        near = (np.abs(middles[a] - middles[b]) <= halves[a] + halves[b]).all(axis=1)
        there = cache(lambda i: placed(bodies[i], poses[i]))
        for k in np.flatnonzero(near).tolist():
            if touch(there(a[k]), there(b[k])):
                yield k

    @cached_property
    def _boxes(self) -> Floats:
        """(2, L, 3): the middle and half the size of the box of each link, in its own frame."""
        return np.array([[body.middle, body.half] for body in self._bodies]).swapaxes(0, 1)

    @cached_property
    def _others(self) -> NDArray[np.intp]:
        """(P, 2) what is held, by a number after those of links, and each link beside the hand."""
        own = self.gripper.links
        links = [i for i, link in enumerate(self._links) if link not in own]
        return np.array([(i, len(self._links)) for i in links], np.intp).reshape(-1, 2)

    @cached_property
    def _pairs(self) -> NDArray[np.intp]:
        """(P, 2) pairs of links that can touch and do not always: not neighbours, apart at rest.

        Convex hulls of links near each other overlap in most positions.
        """
        near = {frozenset((j.parent, j.child)) for j in self.robot.joints}
        pairs = np.array(
            [
                (i, j)
                for (i, a), (j, b) in combinations(enumerate(self._links), 2)
                if self._carrier[i] != self._carrier[j]
                and frozenset((a, b)) not in near
                and not (a in self.gripper.links and b in self.gripper.links)
            ],
            np.intp,
        ).reshape(-1, 2)
        random = np.random.default_rng(0)
        positions = random.uniform(self.low, self.high, (20, len(self.low)))
        often, at_rest = np.zeros(len(pairs)), np.zeros(len(pairs), bool)
        for position in positions:
            often[[*self._touching(self._link_poses(position), pairs)]] += 1 / len(positions)
        at_rest[[*self._touching(self._link_poses(self.rest()), pairs)]] = True
        apart: NDArray[np.intp] = pairs[(often < 0.7) & ~at_rest]
        return apart

    def _configuration(self) -> tuple[Any, tuple[Floats, Floats]]:
        """The arm as mink moves it, one for each thread, and its limits."""
        if not hasattr(self._moved, "configuration"):
            self._moved.configuration = library("mink").Configuration(self._model)
            self._moved.limits = limits_of(self._model)
        return self._moved.configuration, self._moved.limits

    @cached_property
    def _model(self) -> Any:
        """The arm as a model of MuJoCo, whose world is the frame of its root."""
        mujoco = library("mujoco")
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        self.add_to(spec.worldbody)
        return spec.compile()

    def add_to(self, body: Any, number: int = 0) -> None:
        """Add a copy of the arm to a body of a model of MuJoCo, in the frame of its root."""
        mujoco = library("mujoco")
        slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
        copy = f" {number}" if number else ""
        for i, joint in enumerate(self.joints):
            body = body.add_body(name=joint.child + copy, **mujoco_pose(self._before[i]))
            body.explicitinertial, body.mass, body.inertia = True, 1.0, [0.01] * 3
            body.add_joint(
                name=joint.name + copy,
                type=slide if joint.type == "prismatic" else hinge,
                axis=joint.axis,
                limited=True,
                range=[self.low[i], self.high[i]],
            )
        body.add_site(name="grasp" + copy, **mujoco_pose(self._tool))
