"""Grids: what is refused, and that they cover what they are made around."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from navgrid.grid import Grid

metres = st.floats(-100, 100)


@given(a=st.tuples(metres, metres), b=st.tuples(metres, metres), r=st.floats(0.01, 2))
def test_a_grid_around_a_box_covers_it(
    a: tuple[float, float], b: tuple[float, float], r: float
) -> None:
    low = (min(a[0], b[0]), min(a[1], b[1]))
    high = (max(a[0], b[0]), max(a[1], b[1]))
    grid = Grid.around(low, high, r)
    for k in range(2):
        size = grid.shape[1 - k] * r
        assert grid.origin[k] <= low[k] + 1e-9
        assert grid.origin[k] + size >= high[k] - 1e-9
        assert size <= high[k] - low[k] + 2 * r + 1e-9


@pytest.mark.parametrize("resolution", [0, -0.1, math.nan, math.inf])
def test_invalid_resolutions_are_refused(resolution: float) -> None:
    with pytest.raises(ValueError, match="resolution"):
        Grid((0, 0), resolution, (1, 1))
    with pytest.raises(ValueError, match="resolution"):
        Grid.around((0, 0), (1, 1), resolution)


@pytest.mark.parametrize("shape", [(0, 1), (1, -1), (2**16, 2**16)])
def test_invalid_shapes_are_refused(shape: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="cells"):
        Grid((0, 0), 0.05, shape)


def test_an_origin_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match="origin"):
        Grid((math.nan, 0), 0.05, (1, 1))
