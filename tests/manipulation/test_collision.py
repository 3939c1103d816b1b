"""Collisions of approaches, beside linear programs that search a common point of two hulls."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from semmap.manipulation.candidates import grasp_candidates
from semmap.manipulation.collision import Obstacles, convex_body, free_grasps
from semmap.manipulation.solids import solid_of
from tests.manipulation.grippers import Shape, gripper_by_hand, real_gripper
from tests.manipulation.rooms import standing


def hulls_meet(a, b):
    """Whether weights exist that lead to one point of both hulls."""
    sums = np.zeros((2, len(a) + len(b)))
    sums[0, : len(a)] = sums[1, len(a) :] = 1
    meets = np.concatenate([np.concatenate([a, -b]).T, sums])
    return linprog(np.zeros(len(a) + len(b)), A_eq=meets, b_eq=[0, 0, 0, 1, 1]).status == 0


def is_free_by_linear_programs(grasps, i, model, triangles):
    gripper = grasps.gripper
    pose, before = model @ grasps.poses[i], model @ grasps.pre_grasps[i]
    shut = gripper.index(grasps.widths[i])
    for number, link in enumerate(gripper.links):
        corners = gripper.robot.hull(link)
        moved = [at @ gripper.poses[0, number] for at in (pose, before)]
        ways = [np.concatenate([corners @ m[:3, :3].T + m[:3, 3] for m in moved])]
        if any(link in finger for finger in gripper.fingers):
            at = pose @ gripper.poses[shut, number]
            ways.append(corners @ at[:3, :3].T + at[:3, 3])
        for points in ways:
            low, high = points.min(axis=0), points.max(axis=0)
            near = np.all((triangles.min(axis=1) <= high) & (triangles.max(axis=1) >= low), axis=1)
            if any(hulls_meet(points, triangle) for triangle in triangles[near]):
                return False
    return True


@pytest.mark.parametrize("name", ["panda", "pr2"])
def test_free_grasps_in_the_small_house_are_those_of_linear_programs(kitchen, name):
    shape = Shape("cylinder", (0.03, 0.12))
    grasps = grasp_candidates(shape, real_gripper(name))
    model = standing(0.12, kitchen.top)
    item = solid_of(*shape[:2]).mesh().triangles + model[:3, 3]
    room = Obstacles(kitchen.triangles).within(model[:3, 3] - 0.5, model[:3, 3] + 0.5).joined(item)
    found = free_grasps(grasps, model, room)
    assert 20 < found.sum() < len(grasps) - 20
    assert not found[np.char.startswith(grasps.approaches, "bottom")].any()
    random = np.random.default_rng(1)
    for i in random.choice(len(grasps), 12, replace=False):
        assert found[i] == is_free_by_linear_programs(grasps, i, model, room.triangles)


def test_an_approach_is_checked_between_its_ends(tmp_path):
    """A thin wire between pre-grasp and grasp touches neither of the two."""
    grasps = grasp_candidates(Shape("cuboid", (0.03, 0.03, 0.03)), gripper_by_hand(tmp_path))
    top = grasps[np.flatnonzero(grasps.approaches == "top")]
    wire = np.array([[[-1, 0.0, 0.19], [1, 0.0, 0.19], [1, 1e-4, 0.19]]])
    assert not free_grasps(top, np.eye(4), Obstacles(wire)).any()
    for z in (0.04, 0.3):
        above = Obstacles(np.add(wire, (0, 0, z)))
        assert free_grasps(top, np.eye(4), above).all()
    assert free_grasps(top, np.eye(4), Obstacles(np.zeros((0, 3, 3)))).all()


def test_fingers_do_not_close_into_a_neighbour(tmp_path):
    grasps = grasp_candidates(Shape("cuboid", (0.02, 0.09, 0.03)), gripper_by_hand(tmp_path))
    across = grasps[np.char.startswith(grasps.families, "top x 90 0 own")]
    assert len(across) == 1
    neighbour = solid_of("cuboid", (0.004, 0.03, 0.03)).mesh().triangles + np.array((0.016, 0, 0))
    assert not free_grasps(across, np.eye(4), Obstacles(neighbour)).any()
    assert free_grasps(across, np.eye(4), Obstacles(neighbour + np.array((0, 0.06, 0)))).all()


@given(st.integers(0, 10**6))
def test_a_convex_body_touches_what_linear_programs_say(seed):
    random = np.random.default_rng(seed)
    points = random.normal(size=(random.integers(4, 60), 3)) * random.uniform(0.02, 0.2, 3)
    if seed % 3 == 0:
        points[:, 2] = 0  # flat
    triangle = random.normal(0, 0.15, 3) + random.normal(0, 0.08, (3, 3))
    touched = Obstacles(triangle[None]).touched_by([convex_body(points)], [np.eye(4)])
    assert touched == hulls_meet(points, triangle)
