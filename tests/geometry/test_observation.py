"""Observation areas against distances of points."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from semmap.geometry.observation import observation_area

ROOM = shapely.box(0, 0, 5, 4)


@settings(max_examples=100, deadline=None)
@given(
    st.floats(0.5, 4),
    st.floats(0.5, 3),
    st.floats(0, 1),
    st.floats(0.1, 2),
    st.integers(0, 2**32 - 1),
)
def test_a_point_is_in_it_by_its_distance(
    x: float, y: float, near: float, wide: float, seed: int
) -> None:
    table = shapely.affinity.rotate(shapely.box(x - 0.4, y - 0.3, x + 0.4, y + 0.3), seed % 90)
    far = near + wide
    area = observation_area(table, near, far, ROOM)
    points = np.random.default_rng(seed).uniform((-1, -1), (6, 5), (300, 2))
    distance = shapely.distance(table, shapely.points(points))
    wanted = (distance >= near) & (distance <= far) & shapely.contains_xy(ROOM, points)
    close = (np.abs(distance - near) < 2e-3 * far + 1e-9) | (np.abs(distance - far) < 2e-3 * far)
    assert (shapely.contains_xy(area, points) == wanted)[~close].all()


@pytest.mark.parametrize(("near", "far"), [(-0.1, 1), (1, 1), (2, 1), (0, float("inf"))])
def test_distances_that_make_no_ring(near: float, far: float) -> None:
    with pytest.raises(ValueError, match="give 0 <= near < far"):
        observation_area(ROOM, near, far)


def test_a_room_too_small_to_stand_off() -> None:
    with pytest.raises(ValueError, match="give smaller distances"):
        observation_area(shapely.box(1, 1, 2, 2), 4, 5, shapely.box(0, 0, 3, 3))
