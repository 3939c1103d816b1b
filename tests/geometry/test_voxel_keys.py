"""Voxels as keys, and their different ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from semmap.geometry.voxel_keys import keys_of, sorted_unique, voxels_of_keys

FURTHEST = 1 << 20


@given(
    arrays(
        np.int32,
        st.tuples(st.integers(0, 50), st.just(3)),
        elements=st.integers(-FURTHEST, FURTHEST - 1),
    )
)
def test_keys_stand_for_voxels_in_their_order(voxels: NDArray[np.int32]) -> None:
    keys = keys_of(voxels)
    np.testing.assert_array_equal(voxels_of_keys(keys), voxels)
    np.testing.assert_array_equal(
        voxels[np.argsort(keys, kind="stable")], voxels[np.lexsort(voxels.T[::-1])]
    )


@given(
    arrays(np.int64, st.integers(0, 80), elements=st.integers(-9, 9) | st.integers(-(2**62), 2**62))
)
def test_different_numbers_are_those_of_numpy(numbers: NDArray[np.int64]) -> None:
    np.testing.assert_array_equal(sorted_unique(numbers), np.unique(numbers))


@pytest.mark.parametrize("index", [FURTHEST, -FURTHEST - 1, 2**31 - 1, -(2**31)])
@pytest.mark.parametrize("axis", range(3))
def test_a_voxel_too_far_away_is_an_error(index: int, axis: int) -> None:
    voxels = np.zeros((2, 3), np.int32)
    voxels[1, axis] = index
    with pytest.raises(ValueError, match="larger voxels"):
        keys_of(voxels)
