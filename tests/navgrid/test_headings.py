"""Collision checks by heading against shapely, cell by cell."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from navgrid.costmap import Costmap
from navgrid.grid import Grid
from navgrid.headings import collisions, footprint_cells, part_collisions
from tests.navgrid.scenes import ARM, BASE, part, room, scene, solid, square

corners = st.lists(st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6)), min_size=3, max_size=7)


@settings(max_examples=20, deadline=None)
@given(corners, st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_collisions_agree_with_shapely(
    points: list[tuple[float, float]], headings: int, seed: int
) -> None:
    hull = shapely.MultiPoint(points).convex_hull
    if hull.area < 1e-3:
        return
    footprint = np.array(hull.exterior.coords)[:-1]
    occupied = np.random.default_rng(seed).random((12, 14)) < 0.08
    found = part_collisions(occupied, footprint, 0.1, headings)
    r, c = np.nonzero(occupied)
    squares = shapely.box(c * 0.1, r * 0.1, c * 0.1 + 0.1, r * 0.1 + 0.1)
    whole = shapely.union_all(squares)
    rows, columns = np.mgrid[:12, :14]
    for i in range(headings):
        turned = shapely.affinity.rotate(
            shapely.Polygon(footprint), 2 * math.pi * i / headings, (0, 0), use_radians=True
        )
        at = np.stack([columns * 0.1 + 0.05, rows * 0.1 + 0.05], -1)
        placed = np.array(
            [[shapely.affinity.translate(turned, x, y) for x, y in line] for line in at]
        )
        area = shapely.area(shapely.intersection(placed, whole))
        apart = shapely.distance(placed, whole)
        assert found[i][area > 1e-9].all()
        assert not found[i][apart > 1e-9].any()


def test_a_long_robot_passes_a_gap_only_lengthways() -> None:
    walls = [solid(1, (0, 0, 0), (3, 1.0, 1), "wall"), solid(2, (0, 1.42, 0), (3, 2.4, 1), "wall")]
    long = part("base", 0.0, 0.3, [[-0.4, -0.15], [0.4, -0.15], [0.4, 0.15], [-0.4, 0.15]])
    made = Costmap(
        scene(*walls, floors=(room("hall", 0, 0, 3, 2.4),)), [long], Grid((0, 0), 0.02, (120, 150))
    )
    row, column = made.grid.cell(1.5, 1.21)
    found = collisions(made, 8)
    assert found[:, row, column].tolist() == [False, True, True, True, False, True, True, True]


def test_each_part_collides_only_at_its_own_heights() -> None:
    shelf = solid(1, (1.0, 1.0, 0.8), (1.4, 1.4, 1.2), "shelf")
    made = Costmap(scene(shelf), [BASE, ARM], Grid((0, 0), 0.05, (60, 60)))
    found = collisions(made, 4)
    row, column = made.grid.cell(0.825, 1.2)
    assert found[:, row, column].tolist() == [True, False, False, False], "the arm reaches ahead"
    row, column = made.grid.cell(1.2, 1.2)
    assert not found[:, row, column].any(), "the arm is beyond on all sides, the base beneath"


def test_footprint_cells_agree_with_shapely() -> None:
    cells, (row, column) = footprint_cells(square(0.26), 0.0, 0.1)
    assert cells[row - 3 : row + 4, column - 3 : column + 4].all()
    assert cells.sum() == 49
    cells, at = footprint_cells(ARM.footprint, math.pi, 0.1)
    assert np.argwhere(cells)[:, 1].max() < at[1], "turned about, it is behind"


def test_zero_headings_are_refused() -> None:
    with pytest.raises(ValueError, match="give 1 or more"):
        part_collisions(np.zeros((2, 2), bool), BASE.footprint, 0.1, 0)
