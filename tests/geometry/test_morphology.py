"""Closing and opening lose nothing, at any angle."""

from __future__ import annotations

import pytest
import shapely
from hypothesis import example, given
from hypothesis import strategies as st
from shapely import affinity

from semmap.geometry.morphology import without_gaps, without_slivers

boxes = st.lists(
    st.tuples(st.integers(0, 8), st.integers(0, 8), st.integers(1, 8), st.integers(1, 8)),
    min_size=1,
    max_size=4,
)


@given(boxes, st.floats(-3, 3))
@example([(0, 1, 2, 2)], 1.3536961037172848)  # of which GEOS 3.14 leaves nothing
def test_boxes_stay_as_they_are(several: list[tuple[int, int, int, int]], angle: float) -> None:
    shape = shapely.union_all(
        [shapely.box(x / 10, y / 10, (x + w) / 10, (y + h) / 10) for x, y, w, h in several]
    )
    turned = affinity.rotate(shape, angle, origin=(0, 0), use_radians=True)
    for changed in (without_gaps(turned, 0.005), without_slivers(turned, 0.0025)):
        assert changed.symmetric_difference(turned).area < 1e-4


def test_gaps_and_slivers() -> None:
    parted = shapely.union_all([shapely.box(0, 0, 1, 1), shapely.box(1.004, 0, 2, 1)])
    assert without_gaps(parted, 0.005).geom_type == "Polygon"
    assert without_gaps(parted, 0.003).geom_type == "MultiPolygon"
    tailed = shapely.union_all([shapely.box(0, 0, 1, 1), shapely.box(1, 0, 2, 0.004)])
    assert without_slivers(tailed, 0.005).area == pytest.approx(1, abs=1e-4)
    assert without_slivers(tailed, 0.003).area == pytest.approx(1.004, abs=1e-4)
    assert without_slivers(shapely.box(0, 0, 1, 0.004), 0.005).is_empty
