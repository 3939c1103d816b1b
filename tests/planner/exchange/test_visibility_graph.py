"""CornerPaths around corners: inside of the outline, and no longer than those on a fine grid."""

from __future__ import annotations

import math
from itertools import pairwise

import networkx as nx
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.exchange.visibility_graph import CornerPaths, corner_paths

L_ROOM = shapely.Polygon([(0, 0), (8, 0), (8, 2), (2, 2), (2, 8), (0, 8)])


def line(ways: CornerPaths, points: np.ndarray, pair: tuple[int, int]) -> shapely.LineString:
    i, j = pair
    return shapely.LineString([points[i], *ways.corners[ways.between[pair]], points[j]])


def test_a_corridor_with_a_corner_has_one_bend() -> None:
    points = np.array([[7.0, 1.0], [1.0, 7.0], [1.0, 1.0]])
    ways = corner_paths(L_ROOM, points)
    assert ways.between[0, 2] == ways.between[1, 2] == []
    way = line(ways, points, (0, 1))
    assert shapely.get_coordinates(way)[1:-1] == pytest.approx(np.array([[1.7, 1.7]]))


def test_a_column_is_walked_around_and_what_is_apart_has_no_way() -> None:
    ring = shapely.box(0, 0, 10, 4).difference(shapely.box(4, 1, 6, 3))
    points = np.array([[1.0, 2.0], [9.0, 2.0]])
    way = line(corner_paths(ring, points), points, (0, 1))
    assert ring.covers(way)
    assert way.length == pytest.approx(2 * math.hypot(2.7, 1.3) + 2.6)
    apart = shapely.union_all([shapely.box(0, 0, 1, 1), shapely.box(5, 0, 6, 1)])
    assert (0, 1) not in corner_paths(apart, np.array([[0.5, 0.5], [5.5, 0.5]])).between


def test_paths_keep_the_clearance_where_there_is_room() -> None:
    """Two halls joined by a slot of 0.4 m, and a point that is nearer to a wall than 0.3 m."""
    halls = [shapely.box(0, 0, 4, 4), shapely.box(5, 0, 9, 4), shapely.box(4, 1.8, 5, 2.2)]
    outline = shapely.union_all(halls)
    points = np.array([[0.5, 0.5], [3.9, 3.9], [8.0, 0.5], [0.1, 3.0]])
    ways = corner_paths(outline, points, (0.5, 0.3))
    assert len(ways.between) == 6
    inner = shapely.LineString(shapely.get_coordinates(line(ways, points, (0, 1)))[:-1])
    assert inner.distance(outline.boundary) == pytest.approx(0.5)  # left at the last piece alone
    assert line(ways, points, (0, 2)).distance(outline.boundary) == pytest.approx(0.15)
    assert line(ways, points, (0, 3)).length == pytest.approx(2.9)


@st.composite
def rooms(draw: st.DrawFn) -> tuple[shapely.Polygon, np.ndarray]:
    """Rooms of whole metres, one piece, and points in their cells' middles."""
    cells = {(0, 0)}
    for _ in range(draw(st.integers(2, 14))):
        x, y = draw(st.sampled_from(sorted(cells)))
        dx, dy = draw(st.sampled_from([(1, 0), (-1, 0), (0, 1), (0, -1)]))
        cells.add((x + dx, y + dy))
    outline = shapely.union_all([shapely.box(x, y, x + 1, y + 1) for x, y in cells])
    chosen = draw(st.lists(st.sampled_from(sorted(cells)), min_size=2, max_size=4, unique=True))
    return outline, np.array(chosen) + 0.5


@settings(max_examples=40)
@given(room=rooms())
def test_ways_stay_inside_and_are_not_longer_than_those_of_a_grid(
    room: tuple[shapely.Polygon, np.ndarray],
) -> None:
    outline, points = room
    ways = corner_paths(outline, points, (0.1,))
    step = 0.25
    cells = _cells(outline, step)
    grid = nx.Graph()
    for i, j in cells:
        for di, dj in ((1, 0), (0, 1), (1, 1), (1, -1)):
            if {(i + di, j), (i, j + dj), (i + di, j + dj)} <= cells:
                grid.add_edge((i, j), (i + di, j + dj), weight=step * math.hypot(di, dj))
    for i, j in ways.between:
        way = line(ways, points, (i, j))
        assert outline.buffer(0.021, join_style="mitre").covers(way)
        assert all(a != b for a, b in pairwise(ways.between[i, j]))
        assert way.distance(outline.boundary) >= 0.1 - 1e-4
        ends = [tuple(int(v) for v in np.floor(points[n] / step)) for n in (i, j)]
        expected = nx.shortest_path_length(grid, *ends, weight="weight")
        assert way.length <= expected + 4 * step
    assert len(ways.between) == len(points) * (len(points) - 1) // 2


def _cells(outline: shapely.Polygon, step: float) -> set[tuple[int, int]]:
    x0, y0, x1, y1 = (round(v / step) for v in outline.bounds)
    i, j = np.meshgrid(np.arange(x0, x1), np.arange(y0, y1))
    inside = shapely.contains_xy(outline, (i + 0.5) * step, (j + 0.5) * step)
    return set(zip(i[inside].tolist(), j[inside].tolist(), strict=True))
