"""Point clouds become voxels by OpenVDB, the same as by rounding each point down."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from semmap.geometry.voxels import Voxels

coordinates = st.lists(st.tuples(*[st.floats(-40, 40)] * 3), max_size=60)


@given(coordinates, st.sampled_from([0.05, 0.1, 0.03]))
def test_each_point_is_in_a_voxel(points: list[tuple[float, ...]], size: float) -> None:
    found = Voxels.of_points(np.array(points).reshape(-1, 3), size).indices
    wanted = {tuple(np.floor(np.array(p) / size).astype(int).tolist()) for p in points}
    assert {tuple(each) for each in found.tolist()} == wanted
    assert len(found) == len(wanted)


def test_without_openvdb_there_are_no_voxels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "semmap_vdb", None)
    with pytest.raises(LookupError, match="install semmap_vdb"):
        Voxels.of_points([(0.0, 0.0, 0.0)], 0.05)
