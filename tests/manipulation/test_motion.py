"""Arms: forward and inverse kinematics beside yourdfpy, motions checked state by state."""

from __future__ import annotations

import functools

import numpy as np
import pytest
import yourdfpy
from scipy.optimize import linprog

from semmap.geometry.mesh import box_mesh
from semmap.manipulation.arm import Arm
from semmap.manipulation.candidates import grasp_candidates
from semmap.manipulation.collision import Obstacles, convex_body, free_grasps
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.motion import STEP, Held, Stroke, free_strokes, plan_motion
from semmap.manipulation.solids import solid_of
from tests.manipulation.grippers import Shape, gripper_by_hand, real_gripper, urdf

NOTHING = Obstacles(np.zeros((0, 3, 3)))
READY = np.array([0, -0.8, 0, -2.2, 0, 1.6, 0.8])
"""The Panda with its gripper before it."""


def through(obstacles, held=None):
    """Any free motion."""
    return Stroke(np.eye(4), obstacles, held=held)


@functools.cache
def panda():
    return Arm(real_gripper("panda"))


@functools.cache
def reference(name):
    return yourdfpy.URDF.load(
        str(urdf(name)), load_meshes=False, filename_handler=lambda file: file
    )


@pytest.mark.parametrize("name", ["panda", "pr2", "tiago_pro"])
def test_inverse_kinematics_returns_what_forward_kinematics_of_yourdfpy_reaches(name):
    arm = Arm(real_gripper(name))
    other = reference(name)
    random = np.random.default_rng(5)
    root = arm.robot.link_poses({}, [other.base_link])[other.base_link]
    for _ in range(5):
        wanted = arm.grasp_pose(random.uniform(arm.low, arm.high))
        found = arm.reach(wanted)
        assert found is not None
        assert (found >= arm.low).all()
        assert (found <= arm.high).all()
        other.update_cfg(dict(zip((j.name for j in arm.joints), found.tolist(), strict=True)))
        reached = root @ other.get_transform(arm.gripper.palm) @ arm.gripper.frame
        np.testing.assert_allclose(reached[:3, 3], wanted[:3, 3], atol=1e-3)
        np.testing.assert_allclose(reached[:3, :3], wanted[:3, :3], atol=1e-2)


def test_what_is_too_far_is_not_reached():
    far = panda().grasp_pose(READY)
    far[0, 3] += 2
    assert panda().reach(far, starts=2) is None


def test_a_gripper_without_an_arm(tmp_path):
    with pytest.raises(ManipulationError, match="no joint moves palm; give the URDF of a whole"):
        Arm(gripper_by_hand(tmp_path))


def touches(points, low, high):
    """Whether a convex hull meets a box, by a linear program."""
    weights = len(points)
    return (
        linprog(
            np.zeros(weights),
            A_ub=np.concatenate([points.T, -points.T]),
            b_ub=np.concatenate([high, -np.asarray(low)]),
            A_eq=np.ones((1, weights)),
            b_eq=[1],
        ).status
        == 0
    )


def test_a_motion_leads_round_a_wall_with_the_held_object(tmp_path):
    """Each position is checked by yourdfpy's kinematics and linear programs, the object, too."""
    arm, other = panda(), reference("panda")
    low, high = (0.25, -0.01, 0.0), (0.9, 0.01, 0.45)
    wall = Obstacles(box_mesh(low, high).triangles)
    turn = np.array([0.7, 0, 0, 0, 0, 0, 0])
    start, goal = READY + turn, READY - turn
    item = solid_of("cylinder", (0.02, 0.2)).mesh(12)
    corners = item.vertices + np.array((0, 0, 0.09))  # hangs from the pads
    held = Held(convex_body(corners), np.eye(4), 0.04)
    assert len(plan_motion(arm, start, goal, through(wall))) == 29  # the hand alone passes above
    path = plan_motion(arm, start, goal, through(wall, held), 30)
    assert path is not None
    np.testing.assert_allclose(path[[0, -1]], [start, goal], atol=1e-9)
    assert np.abs(np.diff(path, axis=0)).max() <= STEP + 1e-9
    assert ((path >= arm.low) & (path <= arm.high)).all()
    fingers = arm.gripper.posture(0.04)
    straight = 0
    for position in [*path[::6], *np.linspace(start, goal, 9)]:
        state = dict(zip((j.name for j in arm.joints), position.tolist(), strict=True))
        other.update_cfg(state | fingers)
        hulls = [
            arm.robot.hull(link) @ pose[:3, :3].T + pose[:3, 3]
            for link in arm.robot.meshes
            for pose in [other.get_transform(link)]
        ]
        grip = other.get_transform(arm.gripper.palm) @ arm.gripper.frame
        hulls.append(corners @ grip[:3, :3].T + grip[:3, 3])
        hit = any(touches(points, low, high) for points in hulls)
        on_path = (np.abs(path - position).max(axis=1) < 1e-9).any()
        assert not (hit and on_path)
        straight += hit
    assert straight  # the direct way is blocked


def test_the_held_object_is_a_part_of_the_robot():
    """A board below the hand is free for the hand and not for a long object in it."""
    arm = panda()
    grip = arm.grasp_pose(READY)[:3, 3]
    low, high = grip - np.array([0.1, 0.1, 0.2]), grip - np.array([-0.1, -0.1, 0.15])
    board = Obstacles(box_mesh(tuple(low), tuple(high)).triangles)
    body = convex_body(solid_of("cuboid", (0.02, 0.02, 0.3)).mesh().vertices)
    pose = np.eye(4)
    pose[2, 3] = 0.1
    assert arm.is_free(READY, board)
    assert not arm.is_free(READY, board, held=(body, pose))
    assert arm.is_free(READY, NOTHING, held=(body, pose))


def meet(one, other):
    """Whether two convex hulls meet, by a linear program: a point of both."""
    if (one.min(axis=0) > other.max(axis=0)).any() or (other.min(axis=0) > one.max(axis=0)).any():
        return False
    equal = np.concatenate([one.T, -other.T], axis=1)
    sums = np.repeat(np.eye(2), [len(one), len(other)], axis=1)
    cost = np.zeros(len(one) + len(other))
    answer = linprog(cost, A_eq=np.concatenate([equal, sums]), b_eq=[0, 0, 0, 1, 1])
    return answer.status == 0


def test_what_is_held_and_the_hand_touch_the_links_that_linear_programs_say():
    """At random, with a rod in the hand: those of the arm beside the hand, and its first links."""
    arm, other = panda(), reference("panda")
    rod = solid_of("cuboid", (0.03, 0.5, 0.03)).mesh().vertices
    held, hand = (convex_body(rod), np.eye(4)), arm.gripper.links
    first = [link for link in arm.robot.meshes if link[-1] in "012"]
    assert len(first) == 3
    answers = []
    for position in np.random.default_rng(4).uniform(arm.low, arm.high, (300, len(arm.low))):
        state = dict(zip((j.name for j in arm.joints), position.tolist(), strict=True))
        other.update_cfg(state | arm.gripper.postures[0])
        there = {name: other.get_transform(name) for name in arm.robot.meshes}
        hulls = {n: arm.robot.hull(n) @ p[:3, :3].T + p[:3, 3] for n, p in there.items()}
        grip = other.get_transform(arm.gripper.palm) @ arm.gripper.frame
        item = rod @ grip[:3, :3].T + grip[:3, 3]
        alone = arm.is_free(position, NOTHING)
        if any(meet(hulls[a], hulls[b]) for a in first for b in hand if b in hulls):
            assert not alone
            answers.append("hand")
        if alone:
            hit = any(meet(points, item) for name, points in hulls.items() if name not in hand)
            assert arm.is_free(position, NOTHING, held=held) == (not hit)
            answers.append("held" if hit else "free")
    assert min(map(answers.count, ("hand", "held", "free"))) > 1, answers


def test_ends_that_touch_are_refused():
    arm = panda()
    grip = arm.grasp_pose(READY)[:3, 3]
    block = Obstacles(box_mesh(tuple(grip - 0.05), tuple(grip + 0.05)).triangles)
    with pytest.raises(ManipulationError, match="start of the motion: the arm touches"):
        plan_motion(arm, READY, READY + 0.1, through(block))
    with pytest.raises(ManipulationError, match="joint panda_joint4 is beyond"):
        plan_motion(arm, READY, READY + 3 * np.eye(7)[3], through(NOTHING))


class Point:
    """A point in a square with a wall across it, as thin as a step of motions, with one gap."""

    low, high = np.array([-1.0, -1.0]), np.array([1.0, 1.0])

    def __init__(self, x, gap, width):
        self.x, self.gap, self.width = x, gap, width

    def is_free(self, position, *_, **__):
        x, y = position
        return bool(abs(x - self.x) >= self.width / 2 or abs(y - self.gap) <= 0.06)


class Pocket(Point):
    """As its base, with a ring behind the wall that nothing enters."""

    def is_free(self, position, *_, **__):
        ring = 0.1 < np.hypot(position[0] - 0.7, position[1] + 0.1) < 0.3
        return super().is_free(position) and not ring


@pytest.mark.parametrize("width", [0.03, 0.045])
def test_a_motion_that_was_found_is_not_lost_on_the_way_out(width):
    start, goal = np.array([-0.8, 0.1]), np.array([0.8, -0.1])
    for k in range(12):
        point = Point(0.013 * k, 0.15 * k - 0.9, width)
        path = plan_motion(point, start, goal, through(NOTHING), 2)
        assert path is not None
        np.testing.assert_array_equal(path[[0, -1]], [start, goal])
        assert np.abs(np.diff(path, axis=0)).max() <= STEP + 1e-9
        assert all(map(point.is_free, path))


def test_of_several_goals_one_is_reached_that_can_be():
    """The wall has no gap: of several goals, that on this side of it is reached."""
    point = Point(0.0, 5.0, 0.2)
    start, beyond = np.array([-0.8, -0.8]), np.array([0.8, 0.1])
    corner = np.array([-0.8, 0.9])
    assert plan_motion(point, start, beyond, through(NOTHING), 0.3) is None
    for goals in ([beyond, corner], [beyond, 0.9 * beyond, corner]):
        path = plan_motion(point, start, np.array(goals), through(NOTHING), 2)
        np.testing.assert_array_equal(path[[0, -1]], [start, corner])
    pocket = Pocket(0.0, -0.5, 0.2)
    for goals in ([[0.7, -0.1], [0.8, 0.8]], [[0.8, 0.8], [0.7, -0.1]]):
        path = plan_motion(pocket, start, np.array(goals), through(NOTHING), 5)
        np.testing.assert_array_equal(path[[0, -1]], [start, [0.8, 0.8]])
        assert all(map(pocket.is_free, path))


def test_a_can_on_the_kitchen_table_is_picked(kitchen):
    """The first grasp that is reachable and free, in the small house."""
    arm = panda()
    shape = Shape("cylinder", (0.03, 0.12))
    model, base = np.eye(4), np.eye(4)
    edge = kitchen.top.outline.bounds[0]
    base[:3, 3] = edge - 0.25, 0.95, 0.5
    model[:3, 3] = edge + 0.35, 0.95, kitchen.top.height + 0.0605
    inverse = np.linalg.inv(base)
    near = Obstacles(kitchen.triangles).within(base[:3, 3] - 1.2, base[:3, 3] + 1.2)
    room = Obstacles(near.triangles + inverse[:3, 3])
    there = inverse @ model
    item = solid_of(*shape[:2]).mesh().triangles + there[:3, 3]
    grasps = grasp_candidates(shape, arm.gripper)
    around = room.joined(item)
    ends = [
        (i, before, approach)
        for i in np.flatnonzero(free_grasps(grasps, there, room, item=Obstacles(item)))[:12]
        for before, (approach,) in free_strokes(
            arm,
            READY,
            [
                Stroke(there @ grasps.pre_grasps[i], around),
                Stroke(there @ grasps.poses[i], room),
            ],
        )
    ]
    goals = np.array([before for _, before, _ in ends])
    to_pre_grasp = plan_motion(arm, READY, goals, Stroke(np.eye(4), around), 20)
    assert to_pre_grasp is not None
    grasp, _, approach = ends[int(np.abs(goals - to_pre_grasp[-1]).max(axis=1).argmin())]
    np.testing.assert_allclose(arm.grasp_pose(approach[-1]), there @ grasps.poses[grasp], atol=5e-3)
    np.testing.assert_allclose(to_pre_grasp[-1], approach[0], atol=1e-9)
    assert all(arm.is_free(p, around) for p in to_pre_grasp)
    assert all(arm.is_free(p, room) for p in approach)
