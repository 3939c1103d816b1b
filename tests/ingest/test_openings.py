"""Robots face an opening from within its place; a leaf fills the opening."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from semmap.geometry.pose import Pose
from semmap.ingest.openings import approach_pose, door_leaf


@pytest.mark.parametrize(
    ("depth", "distance"),
    [(5.0, 0.6), (0.55, 0.5), (0.45, 0.4), (0.35, 0.3), (0.2, 0.6)],
)
def test_the_first_distance_within_the_place_is_chosen(depth: float, distance: float) -> None:
    frame = Pose.planar(3.0, 1.0, math.pi / 2)
    place = shapely.box(2.0, 1.0 - depth, 4.0, 1.0)
    pose = approach_pose(frame, place, -1)
    assert pose == pytest.approx(Pose.planar(-distance, 0.0))
    behind = approach_pose(frame, shapely.box(2.0, 1.0, 4.0, 1.0 + depth), 1)
    assert behind == pytest.approx(Pose.planar(distance, 0.0, math.pi))


def test_an_unknown_place_gives_the_preferred_distance() -> None:
    assert approach_pose(Pose(), None, 1).x == 0.6


def test_a_leaf_is_as_wide_as_its_opening() -> None:
    mesh = door_leaf(0.9).mesh
    assert mesh is not None
    np.testing.assert_allclose(mesh.bounds, [[-0.025, -0.45, 0.0], [0.025, 0.45, 2.1]])
