"""What areas have in common, against the arithmetic of rectangles before they are turned."""

from __future__ import annotations

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import affinity

from semmap.geometry.overlay import common, united, without

BESIDE = (
    # rooms of a drawing turned by 25 degrees: a corner of both differs by 2e-16 m
    "POLYGON ((5.956714339283241 -39.112834661582916, 1.3987539136400542 -41.26348055724899, "
    "0.3209167964080799 -38.97917195231654, 4.878877222051267 -36.82852605665047, "
    "5.956714339283241 -39.112834661582916))",
    "POLYGON ((7.789351878102862 -42.9968256957745, 3.2313914524596754 -45.14747159144057, "
    "1.3987539136400544 -41.26348055724899, 5.956714339283241 -39.112834661582916, "
    "7.789351878102862 -42.9968256957745))",
)
"""Two rooms that share an edge."""


def test_rooms_that_share_an_edge_have_no_area_in_common():
    a, b = (shapely.from_wkt(text) for text in BESIDE)
    assert shapely.intersection(a, b).area > 12  # else the grid is not needed any more
    assert common(a, b).area == pytest.approx(0, abs=1e-5)
    assert united([a, b]).area == pytest.approx(a.area + b.area, abs=1e-4)
    assert without(a, b).area == pytest.approx(a.area, abs=1e-5)


@given(
    st.tuples(st.floats(0.1, 20), st.floats(0.1, 20), st.floats(0.1, 20)),
    st.floats(0, 1),
    st.tuples(st.floats(0, 360), st.floats(-200, 200), st.floats(-200, 200)),
    st.integers(0, 3),
)
def test_overlays_of_turned_rectangles(sizes, overlap, place, corner):
    wide, other, deep = sizes
    overlap *= min(wide, other)
    angle, x, y = place
    a, b = (
        affinity.translate(affinity.rotate(shapely.box(*box), angle, origin=(0, 0)), x, y)
        for box in ((0, 0, wide, deep), (wide - overlap, 0, wide - overlap + other, deep))
    )
    points = shapely.get_coordinates(b)
    points[corner] *= 1 + 1e-16  # as a pose that is composed again differs
    b = shapely.Polygon(points)
    exact = pytest.approx(overlap * deep, abs=1e-3)
    assert common(a, b).area == exact
    assert a.area + b.area - united([a, b]).area == exact
    assert a.area - without(a, b).area == exact


def test_nothing_united_is_empty():
    assert united([]).is_empty
