"""Cells of polygons against shapely, square by square."""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from navgrid.area import area_cells, flat_triangles
from navgrid.grid import Grid

GRID = Grid((-1.0, -0.5), 0.25, (16, 20))
SQUARES = np.array(
    [
        [
            shapely.box(-1 + c * 0.25, -0.5 + r * 0.25, -0.75 + c * 0.25, -0.25 + r * 0.25)
            for c in range(20)
        ]
        for r in range(16)
    ]
)

points = st.lists(st.tuples(st.floats(-2, 5), st.floats(-2, 5)), min_size=3, max_size=8)


@settings(max_examples=70, deadline=None)
@given(points, points)
def test_area_cells_are_the_cells_that_the_polygon_meets(
    outer: list[tuple[float, float]], hole: list[tuple[float, float]]
) -> None:
    shape = shapely.MultiPoint(outer).convex_hull - shapely.MultiPoint(hole).convex_hull
    shape = shape.buffer(0)
    cells = area_cells(shape, GRID)
    near = shapely.distance(SQUARES, shape) if not shape.is_empty else np.full(GRID.shape, np.inf)
    overlap = shapely.area(shapely.intersection(SQUARES, shape))
    assert not cells[near > 1e-9].any()
    assert cells[overlap > 1e-9].all()


def test_a_border_belongs_to_the_cell_above_and_right_of_it() -> None:
    cells = area_cells(shapely.box(0, 0, 0.5, 0.25), GRID)
    assert np.argwhere(cells).tolist() == [[r, c] for r in (2, 3) for c in (4, 5, 6)]


def test_an_empty_outline_has_no_cells() -> None:
    assert not area_cells(shapely.Polygon(), GRID).any()
    assert not len(flat_triangles(shapely.Point(0, 0)))


def test_flat_triangles_cover_exactly_the_polygon() -> None:
    shape = shapely.MultiPolygon(
        [shapely.box(0, 0, 4, 3) - shapely.box(1, 1, 2, 2), shapely.box(6, 0, 7, 1)]
    )
    parts = shapely.polygons(flat_triangles(shape)[:, :, :2])
    assert shapely.union_all(parts).symmetric_difference(shape).area < 1e-12
    assert abs(shapely.area(parts).sum() - shape.area) < 1e-12
