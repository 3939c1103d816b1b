"""Poses against SciPy's rotations and plain matrices."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from semmap.geometry.pose import Pose

angles = st.floats(-3.1, 3.1)
metres = st.floats(-100, 100)
numbers = st.tuples(metres, metres, metres, angles, angles, angles)


@given(numbers)
def test_roll_pitch_yaw_are_scipys(said: tuple[float, ...]) -> None:
    pose = Pose.from_rpy(*said)
    expected = Rotation.from_euler("xyz", said[3:]).as_matrix()
    np.testing.assert_allclose(pose.rotation_matrix, expected, atol=1e-12)
    np.testing.assert_allclose(pose.rotation.as_matrix(), expected, atol=1e-12)
    np.testing.assert_allclose(pose.translation, said[:3])


@given(numbers, numbers)
def test_composition_is_the_product_of_matrices(a: tuple[float, ...], b: tuple[float, ...]) -> None:
    one, other = Pose.from_rpy(*a), Pose.from_rpy(*b)
    np.testing.assert_allclose((one @ other).matrix, one.matrix @ other.matrix, atol=1e-9)


@given(numbers)
def test_inverse_and_matrix_lead_back(said: tuple[float, ...]) -> None:
    pose = Pose.from_rpy(*said)
    np.testing.assert_allclose((pose @ pose.inverse()).matrix, np.eye(4), atol=1e-9)
    np.testing.assert_allclose(Pose.from_matrix(pose.matrix).matrix, pose.matrix, atol=1e-9)


@given(metres, metres, angles)
def test_a_planar_pose_has_its_yaw(x: float, y: float, yaw: float) -> None:
    assert abs(Pose.planar(x, y, yaw).yaw - yaw) < 1e-9


def test_a_row_has_nothing_that_underflows() -> None:
    row = Pose(x=1, qz=1e-193, qw=1.0).row
    assert row == [1.0, 0, 0, 0, 0, 0, 1.0]
    assert all(type(v) is float for v in row)
