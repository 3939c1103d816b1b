import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from navgrid.travel import DEAREST, travel, way

SHAPES = hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=12)
COSTS = st.sampled_from([0, 0, 0, 1, 100, 252, 253, 254, 255])
costmaps = hnp.arrays(np.uint8, SHAPES, elements=COSTS)
slows = st.sampled_from([0.0, 1.0, 2.5, 40.0])

BESIDE = {
    (0, 1): [],
    (1, 0): [],
    (1, 1): [(0, 1), (1, 0)],
    (1, -1): [(0, -1), (1, 0)],
    (1, 2): [(0, 1), (1, 1)],
    (1, -2): [(0, -1), (1, -1)],
    (2, 1): [(1, 0), (1, 1)],
    (2, -1): [(1, 0), (1, -1)],
}


def priced(costs, a, b, slow):
    mean = (float(costs[a]) + float(costs[b])) / 2
    return math.dist(a, b) * (1 + slow * mean / 252)


def steps(costs, slow):
    """All open steps as a sparse array, by plain loops: the oracle's graph."""
    index = np.arange(costs.size).reshape(costs.shape)
    free = {tuple(c) for c in np.argwhere(costs < 253).tolist()}
    tails, heads, prices = [], [], []
    for r, c in free:
        for (dr, dc), beside in BESIDE.items():
            if {(r + dr, c + dc), *((r + i, c + j) for i, j in beside)} <= free:
                a, b = (r, c), (r + dr, c + dc)
                tails += [index[a], index[b]]
                heads += [index[b], index[a]]
                prices += [priced(costs, a, b, slow)] * 2
    return coo_array((prices, (tails, heads)), shape=(costs.size, costs.size)).tocsr()


def by_scipy(costs, cells, slow):
    index = np.ravel_multi_index(np.transpose(cells), costs.shape)
    prices = dijkstra(steps(costs, slow), indices=index)[:, index]
    blocked = costs.ravel()[index] >= 253
    prices[blocked] = prices[:, blocked] = np.inf
    return prices


def some_cells(data, costs, least=1):
    rows, columns = (st.integers(0, n - 1) for n in costs.shape)
    return data.draw(st.lists(st.tuples(rows, columns), min_size=least, max_size=6))


@settings(max_examples=60)
@given(costmaps, slows, st.sampled_from([0.05, 0.3]), st.data())
def test_prices_agree_with_scipy(costs, slow, resolution, data):
    cells = some_cells(data, costs)
    expected = by_scipy(costs, cells, slow) * resolution
    prices, metres = travel(costs, resolution, cells, slow=slow)
    np.testing.assert_allclose(prices, expected, rtol=1e-12)
    np.testing.assert_array_equal(np.isinf(metres), np.isinf(prices))
    np.testing.assert_array_equal(prices, prices.T)
    np.testing.assert_array_equal(metres, metres.T)
    for middle in range(len(cells)):  # no way is cheaper by a detour
        detour = prices[:, middle, None] + prices[None, middle, :]
        assert (prices <= detour * (1 + 1e-12)).all()

    goals = cells[: len(cells) // 2 + 1]
    directed, _ = travel(costs, resolution, cells, slow=slow, targets=goals, threads=1)
    np.testing.assert_allclose(directed, expected[:, : len(goals)], rtol=1e-12)
    several = travel(costs, resolution, cells, slow=slow, targets=goals, threads=3)
    np.testing.assert_array_equal(several[0], directed)


@settings(max_examples=50)
@given(costmaps, slows, st.data())
def test_a_path_is_passable_and_has_the_price_and_length_of_travel(costs, slow, data):
    start, goal = some_cells(data, costs, least=2)[:2]
    prices, metres = travel(costs, 0.1, [start], slow=slow, targets=[goal])
    found = way(costs, 0.1, start, goal, slow=slow)
    if found is None:
        assert np.isinf(prices).all()
        return
    cells = [tuple(c) for c in found.tolist()]
    assert cells[0] == start
    assert cells[-1] == goal
    open_steps = steps(costs, slow)
    for a, b in pairwise(cells):
        assert open_steps[tuple(np.ravel_multi_index(np.transpose([a, b]), costs.shape))] > 0
    total = 0.1 * sum(priced(costs, a, b, slow) for a, b in pairwise(cells))
    assert total == pytest.approx(prices[0, 0], rel=1e-12)
    length = 0.1 * sum(math.dist(a, b) for a, b in pairwise(cells))
    assert length == pytest.approx(metres[0, 0], rel=1e-12)


@settings(max_examples=60)
@given(hnp.arrays(np.uint8, (9, 13), elements=COSTS), st.integers(1, 11))
@example(np.zeros((9, 13), np.uint8), 6)
def test_a_wall_has_no_path_and_a_gap_has_one(costs, column):
    costs[4] = 0
    costs[:, column] = 254
    ends = [(4, 0), (4, 12)]
    assert np.isinf(travel(costs, 0.1, ends)[0][0, 1])
    assert way(costs, 0.1, *ends) is None
    costs[4, column] = 0
    assert travel(costs, 0.1, ends)[1][0, 1] == pytest.approx(1.2)


def test_the_expensive_side_of_a_corridor_is_avoided():
    costs = np.full((5, 40), 200, np.uint8)
    costs[2] = 0
    found = way(costs, 0.05, (2, 0), (2, 39))
    np.testing.assert_array_equal(found[:, 0], 2)
    (prices, metres) = travel(costs, 0.05, [(2, 0), (2, 39)], slow=5)
    assert prices[0, 1] == pytest.approx(metres[0, 1]) == pytest.approx(39 * 0.05)


def test_without_slowness_only_the_length_counts_and_16_directions_are_near_the_beeline():
    rng = np.random.default_rng(3)
    costs = rng.integers(0, 253, (60, 60)).astype(np.uint8)
    ends = [(3, 4), (50, 31)]
    prices, metres = travel(costs, 0.1, ends, slow=0)
    np.testing.assert_allclose(prices, metres)
    assert 0.1 * math.dist(*ends) <= metres[0, 1] <= 1.03 * 0.1 * math.dist(*ends)


def test_the_largest_slowness_and_a_large_room_agree_with_scipy():
    rng = np.random.default_rng(4)
    costs = rng.choice([0, 0, 0, 60, 252, 254], (40, 50)).astype(np.uint8)
    cells = rng.integers(0, (40, 50), (8, 2))
    for slow in (1.0, DEAREST):
        prices, _ = travel(costs, 1.0, cells, slow=slow)
        np.testing.assert_allclose(prices, by_scipy(costs, cells, slow), rtol=1e-12)


def test_no_cells_give_an_empty_result():
    costs = np.zeros((4, 4), np.uint8)
    assert travel(costs, 0.1, [])[0].shape == (0, 0)
    assert travel(costs, 0.1, [(0, 0)], targets=[])[0].shape == (1, 0)
    assert travel(costs, 0.1, [], targets=[(0, 0)])[1].shape == (0, 1)
    np.testing.assert_array_equal(way(costs, 0.1, (1, 2), (1, 2)), [[1, 2]])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros(4, np.uint8), 0.1, [(0, 0)]), "costs is uint8 of shape"),
        ((np.zeros((4, 4)), 0.1, [(0, 0)]), "costs is float64 .* array of uint8"),
        ((np.zeros((4, 4), np.uint8), 0.0, [(0, 0)]), "resolution"),
        ((np.zeros((4, 4), np.uint8), math.nan, [(0, 0)]), "resolution"),
        ((np.zeros((4, 4), np.uint8), 0.1, [(0, 4)]), r"\(0, 4\) is outside"),
        ((np.zeros((4, 4), np.uint8), 0.1, [(-1, 0)]), r"\(-1, 0\) is outside"),
        ((np.zeros((4, 4), np.uint8), 0.1, [(0.5, 1)]), "whole numbers"),
        ((np.zeros((4, 4), np.uint8), 0.1, [1, 2]), "whole numbers"),
    ],
)
def test_invalid_arguments_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        travel(*arguments)
    with pytest.raises(ValueError, match=message):
        way(*arguments[:2], *arguments[2], (0, 0)) if len(arguments[2]) == 1 else travel(*arguments)


def test_slowness_and_threads_are_checked():
    costs = np.zeros((4, 4), np.uint8)
    for slow in (-1.0, math.nan, math.inf, 2 * DEAREST):
        with pytest.raises(ValueError, match="give 0 to"):
            travel(costs, 0.1, [(0, 0)], slow=slow)
    with pytest.raises(ValueError, match="threads is 0; give 1 or more"):
        travel(costs, 0.1, [(0, 0)], threads=0)
