"""Grids of one value a voxel against arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from semmap.fields import Box, Sphere, voxels_of
from semmap_vdb import BoolGrid, FloatGrid, Int32Grid

GRIDS = (
    (BoolGrid, False, True, True, np.bool_),
    (Int32Grid, -1, 7, -3, np.int32),
    (FloatGrid, 0.25, 1.5, -2.0, np.float32),
)
LOW, SIDE = (-20, -20, -20), 40


@pytest.mark.parametrize(("kind", "background", "one", "other", "dtype"), GRIDS)
@settings(deadline=None, max_examples=15)
@given(
    changes=st.lists(
        st.tuples(
            st.sampled_from(["one", "other", "clear"]),
            st.tuples(*(st.integers(-8, 8),) * 3),
            st.sampled_from([1.0, 3.0, 8.0, 9.0]),
            st.booleans(),
        ),
        max_size=6,
    )
)
def test_regions_in_and_out(
    kind: type, background: object, one: object, other: object, dtype: type, changes: list
) -> None:
    """Filling and clearing regions has the same result as in an array."""
    grid = kind(0.5, background)
    dense = np.full((SIDE,) * 3, background, dtype)
    active = np.zeros((SIDE,) * 3, np.bool_)
    for what, center, radius, boxed in changes:
        place = np.array(center) / 2
        region = Box(place, (radius, radius, 4.0)) if boxed else Sphere(place, radius / 2)
        at = tuple((voxels_of(region, 0.5) - LOW).T)
        if what == "clear":
            grid.clear(region.shape)
            dense[at], active[at] = background, False
        else:
            value = one if what == "one" else other
            grid.fill(region.shape, value)
            dense[at], active[at] = value, True
        assert (grid.read_box(LOW, (SIDE,) * 3) == dense).all()
        assert len(grid) == active.sum()
        voxels, values = grid.read()
        assert values.dtype == dtype
        assert (values == dense[tuple((voxels - LOW).T)]).all()
        assert set(map(tuple, voxels.tolist())) == set(
            map(tuple, (np.argwhere(active) + LOW).tolist())
        )


@pytest.mark.parametrize(("kind", "background", "one", "other", "dtype"), GRIDS)
def test_points_of_the_shared_frame(
    kind: type, background: object, one: object, other: object, dtype: type
) -> None:
    """A placed grid answers for points of the shared frame."""
    random = np.random.default_rng(2)
    turn, shift = Rotation.random(rng=random), random.uniform(-5, 5, 3)
    grid = kind(0.25, background)
    voxels = random.integers(-30, 30, (500, 3)).astype(np.int32)
    voxels = np.unique(voxels, axis=0)
    values = np.where(random.uniform(size=len(voxels)) < 0.5, one, other).astype(dtype)
    grid.set(voxels, values)
    grid.place(np.column_stack([turn.as_matrix(), shift]).tolist())
    points = turn.apply((voxels + random.uniform(0.01, 0.99, voxels.shape)) * 0.25) + shift
    assert (grid.at(points) == values).all()


def test_file(tmp_path: Path) -> None:
    """A `.vdb` file holds the format's mark."""
    grid = FloatGrid(0.1, 0.0)
    grid.fill(Sphere((0, 0, 0), 1).shape, 1.0)
    grid.write(str(tmp_path / "space.vdb"), "personal_space")
    data = (tmp_path / "space.vdb").read_bytes()
    assert data[:4] == b" BDV"
    assert b"personal_space" in data
