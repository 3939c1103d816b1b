"""What outcomes let expect, beside numbers by hand, and shifts beside the vectors that they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from semmap.geometry.pose import Pose
from semmap.manipulation.candidates import grasp_candidates
from semmap.manipulation.evaluation import group_of, shifted
from semmap.manipulation.ranking import Evidence, Tally, best_first
from tests.manipulation.grippers import Shape, real_gripper

TOP, SIDE = "top y 90 0 own", "side x 0 0 own"


def test_each_level_is_the_prior_of_the_next_one() -> None:
    evidence = Evidence()
    assert evidence.expected(TOP, 0.8) == 0.8
    evidence.add(TOP, False, Tally(2, 1))  # similar shapes: half of two attempts
    share = (1 + 0.5) / (2 + 0.5)  # of all grasps
    assert evidence.expected(SIDE, 0.8) == pytest.approx(share * 0.8)
    alike = (1 + 0.5 * share * 0.8) / 2.5
    assert evidence.expected(TOP, 0.8) == pytest.approx(alike)
    evidence.add(TOP, True, Tally(3, 0))  # this object: one failure of this action, two of others
    near = (0.5 * alike) / (0.5 * 2 + 0.5)
    assert evidence.expected(TOP, 0.8, Tally(1, 0)) == pytest.approx(0.5 * near / 1.5)
    assert evidence.expected(SIDE, 0.8) == pytest.approx(share * 0.8)
    assert evidence.expected(TOP, 0.8, moved=True) == pytest.approx(share * 0.8)


def test_what_mostly_succeeded_comes_before_what_promises_more() -> None:
    rows = [
        {"action_id": 1, "attempts": 0, "successes": 0, "expected": 0.9},
        {"action_id": 2, "attempts": 2, "successes": 1, "expected": 0.4},
        {"action_id": 3, "attempts": 3, "successes": 1, "expected": 0.8},
        {"action_id": 4, "attempts": 1, "successes": 1, "expected": 0.6},
    ]
    assert [row["action_id"] for row in best_first(rows)] == [4, 2, 1, 3]


@settings(max_examples=10)
@given(
    turn=st.tuples(*[st.floats(-3, 3)] * 3),
    way=st.floats(0.01, 0.1),
    scale=st.floats(0.5, 2),
)
def test_a_shift_along_a_bar_is_one_along_similar_bars_at_all_angles(
    turn: tuple[float, float, float], way: float, scale: float
) -> None:
    """The bar of the map lies turned in its frame, and is of another length."""
    gripper, length = real_gripper("panda"), 0.24
    bar = grasp_candidates(Shape("cuboid", (length, 0.04, 0.05)), gripper)
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    size = (scale * length, 0.04, 0.05)
    other = grasp_candidates(Shape("cuboid", size, pose), gripper)
    group = group_of("above y 56 0 own")
    learned = next(g for g in bar if g.family == "above y 56 0 own")
    evidence = Evidence()
    shift = learned.pose[:3, :3].T @ [way, 0, 0]
    place = Pose.from_matrix(learned.pose)
    evidence.add(learned.family, False, Tally(1, 1), shift.tolist(), place, length)
    alike = [g for g in other if group_of(g.family) == group]
    assert len({g.family for g in alike}) > 4
    for grasp in alike:
        found = evidence.shift(grasp, pose, scale * length)
        assert found is not None
        moved = shifted(grasp, found).pose[:3, 3] - grasp.pose[:3, 3]
        np.testing.assert_allclose(moved, scale * way * pose[:3, 0], atol=1e-9)
    side = next(g for g in other if group_of(g.family) != group)
    assert evidence.shift(side, pose, scale * length) is None


def test_what_only_reaches_further_does_so_along_each_approach() -> None:
    gripper = real_gripper("panda")
    grasps = grasp_candidates(Shape("cylinder", (0.03, 0.12)), gripper)
    first, *others = [g for g in grasps if group_of(g.family) == group_of(grasps[0].family)]
    evidence = Evidence()
    evidence.add(
        first.family, False, Tally(1, 1), [0, 0, 0.015], Pose.from_matrix(first.pose), 0.12
    )
    for grasp in others:
        assert evidence.shift(grasp, np.eye(4), 0.12) == pytest.approx([0, 0, 0.015])
    too_far = Evidence()
    too_far.add(first.family, False, Tally(1, 1), [0, 5, 0], Pose.from_matrix(first.pose), 0.12)
    assert too_far.shift(first, np.eye(4), 0.12) is None
