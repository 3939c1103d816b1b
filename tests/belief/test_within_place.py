"""Positions within places: against SciPy's densities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from semmap.belief.error import BeliefError
from semmap.belief.within_place import STAYS, position_likelihood

METRES = st.floats(-2, 2)


@given(METRES, METRES, st.floats(0, 0.1), st.floats(0.5, 20), st.floats(0, 1))
def test_it_is_the_density_over_that_of_anywhere(
    x: float, y: float, z: float, area: float, stayed: float
) -> None:
    known = [[[0.0, 0.0, 0.0, 0.1]]]
    found = position_likelihood([[x, y, z]], known, [area], [[stayed]], spread=0.1)
    normal = multivariate_normal(cov=0.01 * np.eye(2)).pdf([x, y])
    share = STAYS * stayed
    assert found[0, 0] == pytest.approx((share * normal + (1 - share) / area) * area)


def test_above_and_below_it_the_likelihood_falls() -> None:
    known = [[[0.0, 0.0, 1.0, 1.2]]]
    heights = (0.5, 1.0, 1.1, 1.2, 1.7)
    found = [position_likelihood([[0, 0, z]], known, [1.0], [[1.0]])[0, 0] for z in heights]
    assert found[1] == found[2] == found[3] > 10
    assert found[0] == found[4] == pytest.approx(1 - STAYS, abs=1e-3)


def test_an_unknown_position_or_area_says_nothing() -> None:
    point, box = [[0.0, 0.0, 0.0]], [0.0, 0.0, 0.0, 0.1]
    assert position_likelihood(point, [[[math.nan] * 4]], [1.0], [[1.0]]) == [[1.0]]
    assert position_likelihood(point, [[box]], [math.nan], [[1.0]]) == [[1.0]]
    assert position_likelihood(point, [[box]], [1.0], [[math.nan]]) == [[1.0]]
    with pytest.raises(BeliefError, match="spread is 0"):
        position_likelihood(point, [[box]], [1.0], [[1.0]], spread=0)
