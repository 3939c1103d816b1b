import math
from itertools import pairwise

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from navgrid.grid import Grid
from planner.grid_path import grid_path

GRID = Grid((-1.0, 0.5), 0.1, (14, 20))
worlds = hnp.arrays(np.int8, GRID.shape, elements=st.sampled_from([0, 0, 0, -1, 100]))


def centre(cell):
    row, column = cell
    return (-1.0 + 0.1 * (column + 0.5), 0.5 + 0.1 * (row + 0.5))


def joined(cells):
    """Free cells as a graph, by plain loops: eight neighbours, no corner cut."""
    graph = nx.Graph()
    free = {tuple(map(int, c)) for c in np.argwhere(cells < 50)}
    graph.add_nodes_from(free)
    for r, c in free:
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
            if {(r + dr, c + dc), (r + dr, c), (r, c + dc)} <= free:
                graph.add_edge((r, c), (r + dr, c + dc))
    return graph


@settings(max_examples=60, deadline=None)
@given(worlds, st.data())
def test_a_way_is_found_where_there_is_one_and_meets_nothing(cells, data):
    free = [tuple(map(int, c)) for c in np.argwhere(cells < 50)]
    if not free:
        return
    a, b = data.draw(st.sampled_from(free)), data.draw(st.sampled_from(free))
    path = grid_path(GRID, cells, centre(a), centre(b))
    assert (path is not None) == nx.has_path(joined(cells), a, b)
    if path is None:
        return
    np.testing.assert_allclose(path[0], centre(a))
    np.testing.assert_allclose(path[-1], centre(b))
    for p, q in pairwise(path):
        for s in np.linspace(0, 1, 60):
            x, y = p + s * (q - p)
            # a cell's corner may be passed at less than half a cell
            row, column = (y - 0.5) / 0.1, (x + 1.0) / 0.1
            near = cells[
                max(int(row - 0.45), 0) : int(row + 0.45) + 1,
                max(int(column - 0.45), 0) : int(column + 0.45) + 1,
            ]
            assert (near < 50).any()


def test_in_the_open_the_way_is_straight():
    path = grid_path(GRID, np.zeros(GRID.shape, np.int8), (-0.5, 0.7), (0.7, 1.6), clearance=0.01)
    assert path is not None
    length = sum(math.dist(p, q) for p, q in pairwise(path))
    assert length == pytest.approx(1.5, rel=0.03)


def test_a_way_keeps_clear_of_walls_where_it_can():
    grid = Grid((0.0, 0.0), 0.05, (60, 120))
    cells = np.zeros(grid.shape, np.int8)
    cells[:, 59:61] = 100
    cells[24:44, 59:61] = 0  # a gap of 1 m, from y = 1.2 to 2.2
    path = grid_path(grid, cells, (1.0, 1.3), (5.0, 1.3))
    assert path is not None
    crossing = np.interp(3.0, path[:, 0], path[:, 1])
    assert 1.45 < crossing < 1.95


def test_ends_in_an_obstacle_begin_beside_it_and_a_full_grid_has_no_way():
    cells = np.zeros(GRID.shape, np.int8)
    cells[5:8, 5:8] = 100
    path = grid_path(GRID, cells, centre((6, 6)), centre((12, 12)))
    assert path is not None
    np.testing.assert_allclose(path[0], centre((6, 6)))
    assert grid_path(GRID, np.full(GRID.shape, 100, np.int8), (0, 1), (0, 1)) is None
