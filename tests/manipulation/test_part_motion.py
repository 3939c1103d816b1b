"""Hinges and slides against closed forms: circles, lines, and quaternions of SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from semmap.geometry.pose import Pose
from semmap.manipulation.action_record import ActionRecord
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.part_motion import PartMotion

lengths = st.floats(-2, 2)
points = st.tuples(lengths, lengths, lengths)
directions = points.filter(lambda v: np.linalg.norm(v) > 0.1)
amounts = st.floats(-2.5, 2.5).filter(lambda v: abs(v) > 0.01)
shares = st.floats(0, 1)


@given(points, directions, amounts, shares, points)
def test_a_hinge_leads_points_on_circles(point, direction, angle, share, given_point) -> None:
    motion = PartMotion.about((*point, *direction), angle)
    at = motion.at(share)
    start = np.array(given_point)
    end = at[:3, :3] @ start + at[:3, 3]
    axis = np.array(direction) / np.linalg.norm(direction)
    turn = Rotation.from_rotvec(share * angle * axis)
    assert np.allclose(end, turn.apply(start - point) + point, atol=1e-9)
    # On the circle: as far from the axis, and as far along it.
    lever = motion.levers(np.array([start, end]))
    assert lever[0] == pytest.approx(lever[1], abs=1e-9)
    assert axis @ (end - start) == pytest.approx(0, abs=1e-9)
    chord = 2 * lever[0] * abs(np.sin(share * angle / 2))
    assert np.linalg.norm(end - start) == pytest.approx(chord, abs=1e-9)


@given(points, directions, amounts, points)
def test_points_begin_to_move_as_their_headings_say(point, direction, angle, given_point) -> None:
    for motion in (
        PartMotion.about((*point, *direction), angle),
        PartMotion.along(direction, angle),
    ):
        start = np.array([given_point])
        if motion.levers(start)[0] < 1e-3:
            continue
        step = 1e-6
        moved = motion.at(step)[:3, :3] @ start[0] + motion.at(step)[:3, 3] - start[0]
        assert np.allclose(moved / np.linalg.norm(moved), motion.headings(start)[0], atol=1e-3)


@given(points, directions, amounts, points, directions)
def test_numbers_frames_and_records_keep_a_motion(point, direction, angle, at, turn) -> None:
    frame = Pose.from_matrix(
        np.block(
            [
                [Rotation.from_rotvec(turn).as_matrix(), np.array(at)[:, None]],
                [np.zeros((1, 3)), np.ones((1, 1))],
            ]
        )
    )
    for motion in (
        PartMotion.about((*point, *direction), angle),
        PartMotion.along(direction, abs(angle)),
    ):
        again = PartMotion.of_numbers(motion.numbers)
        assert np.allclose(again.at(1), motion.at(1), atol=1e-9)
        assert again.is_like(motion)
        moved = motion.moved(frame)
        expected = frame.matrix @ motion.at(0.7) @ np.linalg.inv(frame.matrix)
        assert np.allclose(moved.at(0.7), expected, atol=1e-7)
        record = ActionRecord("open", Pose(), motion=motion.numbers).moved(frame)
        assert np.allclose(PartMotion.of_numbers(record.motion).at(1), moved.at(1), atol=1e-7)


@given(points, directions, amounts)
def test_steps_are_small_and_lead_to_the_end(point, direction, angle) -> None:
    corners = np.array([point, (1.0, 0.5, 0), (0.3, 2.0, 1.0)])
    for motion in (
        PartMotion.about((0, 0, 0, *direction), angle),
        PartMotion.along(direction, angle),
    ):
        steps = motion.steps(corners)
        assert np.allclose(steps[0], np.eye(4))
        assert np.allclose(steps[-1], motion.at(1))
        ways = np.einsum("kij,nj->kni", steps, np.c_[corners, np.ones(3)])
        assert np.linalg.norm(np.diff(ways, axis=0), axis=2).max() < 0.0201


def test_other_motions_are_not_alike() -> None:
    door = PartMotion.about((0, 0, 0, 0, 0, 1), 1.0)
    assert door.is_like(PartMotion.about((0, 0, 5, 0, 0, -2), -1.0))
    for other in (
        PartMotion.about((0, 0, 0, 0, 0, 1), -1.0),
        PartMotion.about((0, 0, 0, 0, 0, 1), 1.1),
        PartMotion.about((0.01, 0, 0, 0, 0, 1), 1.0),
        PartMotion.about((0, 0, 0, 0, 0.1, 1), 1.0),
        PartMotion.along((0, 0, 1), 1.0),
    ):
        assert not door.is_like(other)


@pytest.mark.parametrize(
    ("make", "numbers", "amount", "message"),
    [
        (PartMotion.about, (0, 0, 0, 0, 0, 0), 1, "hinge is .*: give a point of the axis and"),
        (PartMotion.about, (0, 0, 0, 1), 1, "hinge is"),
        (PartMotion.about, (0, 0, float("nan"), 0, 0, 1), 1, "hinge is"),
        (PartMotion.about, (0, 0, 0, 0, 0, 1), 0, "travel is 0: give radians, not 0"),
        (PartMotion.along, (0, 0, 0), 1, "slide is .*: give its direction"),
        (PartMotion.along, (0, 0, 1), float("inf"), "travel is inf: give metres"),
    ],
)
def test_what_is_no_motion_is_refused(make, numbers, amount, message) -> None:
    with pytest.raises(ManipulationError, match=message):
        make(numbers, amount)
