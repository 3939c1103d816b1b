"""Similarities against NumPy's least squares and against themselves."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from semmap.ingest.rmf.alignment import Similarity, fit_similarity

coordinates = st.floats(-1000, 1000)
points = st.lists(st.tuples(coordinates, coordinates), min_size=2, max_size=8, unique=True)
similarities = st.builds(
    Similarity,
    st.floats(0.01, 100),
    st.floats(-3.1, 3.1),
    coordinates,
    coordinates,
)


def spread(source):
    return np.linalg.norm(np.ptp(np.array(source), axis=0))


@given(points, similarities)
def test_finds_the_similarity_that_was_applied(source, wanted):
    assume(spread(source) > 1)
    found = fit_similarity(source, wanted.apply(source))
    assert found.scale == pytest.approx(wanted.scale, rel=1e-6)
    assert math.cos(found.yaw - wanted.yaw) == pytest.approx(1, abs=1e-9)
    np.testing.assert_allclose(found.apply(source), wanted.apply(source), atol=1e-5)


@given(points, st.data())
def test_agrees_with_linear_least_squares(source, data):
    assume(spread(source) > 1)
    target = np.array(
        data.draw(
            st.lists(
                st.tuples(coordinates, coordinates), min_size=len(source), max_size=len(source)
            )
        )
    )
    p = np.array(source)
    zeros, ones = np.zeros(len(p)), np.ones(len(p))
    system = np.concatenate(
        [
            np.column_stack([p[:, 0], -p[:, 1], ones, zeros]),
            np.column_stack([p[:, 1], p[:, 0], zeros, ones]),
        ]
    )
    wanted, *_ = np.linalg.lstsq(system, np.concatenate([target[:, 0], target[:, 1]]), rcond=None)
    assume(np.hypot(*wanted[:2]) > 1e-6)
    found = fit_similarity(source, target).apply(p)
    expected = (system @ wanted).reshape(2, -1).T
    np.testing.assert_allclose(found, expected, atol=1e-4)


@pytest.mark.parametrize(
    ("source", "target"),
    [
        ([(1, 1)], [(2, 2)]),
        ([(1, 1), (1, 1)], [(0, 0), (1, 0)]),
        ([(0, 0), (1, 0)], [(5, 5), (5, 5)]),
    ],
)
def test_points_that_fix_no_similarity_are_refused(source, target):
    with pytest.raises(ValueError, match=r"distinct|scale"):
        fit_similarity(source, target)
