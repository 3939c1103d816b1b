"""The extent of points equals NumPy's own reductions, for every shape and type."""

from __future__ import annotations

import numpy as np
import pytest

from semmap.geometry.extent import extent


@pytest.mark.parametrize("shape", [(1, 3), (50, 3), (7, 3, 3), (20, 2)])
@pytest.mark.parametrize("dtype", [np.float64, np.int64])
def test_the_extent_is_that_of_all_points(shape: tuple[int, ...], dtype: type) -> None:
    points = (100 * np.random.default_rng(0).normal(size=shape)).astype(dtype)
    low, high = extent(points)
    axes = tuple(range(len(shape) - 1))
    assert (low == points.min(axis=axes)).all()
    assert (high == points.max(axis=axes)).all()
    assert low.dtype == high.dtype == dtype
