import itertools
import math
import time
from concurrent.futures import ThreadPoolExecutor

import networkx as nx
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from planner.graph import Graph

WEIGHTS = (0.0, 0.5, 1.0, 1.5, 2.0, 4.0, 7.25, math.inf)
FEW, MANY = 9, 230  # nodes; landmarks are computed for 200 and more
SAME = {"rtol": 1e-12, "atol": 1e-12}


class Drawn:
    """A random graph, and the oracle's answers to it."""

    def __init__(self, seed, n, *, closed=True):
        self.random = np.random.default_rng(seed)
        self.n = n
        edges = self.random.integers(0, 4 * n if n else 1)
        self.tails, self.heads = self.random.integers(0, n, (2, edges)) if n else [[]] * 2
        self.weights = self.weight(edges, closed)

    def weight(self, count, closed=True):
        """Plain numbers with ties, uneven ones, or some of any magnitude."""
        plain = self.random.choice(WEIGHTS if closed else WEIGHTS[:-1], count)
        uneven = plain * self.random.uniform(0.5, 1.5, count)
        wild = uneven * 10.0 ** self.random.integers(-6, 9, count)
        kinds = [plain, uneven, uneven, wild, 1e300 * plain]
        return kinds[self.random.integers(len(kinds))]

    def graph(self, **options):
        return Graph(self.tails, self.heads, self.weights, self.n, **options)

    def ends(self):
        some = self.random.integers(0, self.n, self.random.integers(1, 4)).tolist()
        return [(node, float(self.random.choice([0.0, 0.25, 3.0]))) for node in some]

    def costs(self):
        """Between all nodes by scipy, which knows no parallel edges, and takes 0 for none."""
        least = {}
        for tail, head, weight in zip(self.tails, self.heads, self.weights, strict=True):
            if math.isfinite(weight):
                least[tail, head] = min(weight, least.get((tail, head), math.inf))
        ends = np.array(list(least), dtype=int).reshape(-1, 2).T
        tiny = np.array(list(least.values())) + 1e-300
        return dijkstra(coo_array((tiny, tuple(ends)), shape=(self.n, self.n)).tocsr())

    def cheapest(self, sources, targets, costs):
        return min(a + costs[s, t] + b for s, a in sources for t, b in targets)

    def check(self, found, sources, targets, expected):
        """A way leads from a source to a target, and costs what it says and is expected."""
        if found is None:
            assert math.isinf(expected)
            return
        cost, edges = found
        np.testing.assert_allclose(cost, expected, **SAME)
        assert edges.dtype == np.int64
        for a, b in itertools.pairwise(edges):
            assert self.heads[a] == self.tails[b]
        if len(edges):
            ends = [(self.tails[edges[0]], self.heads[edges[-1]])]
        else:
            ends = [(s, s) for s, _ in sources]
        totals = [
            a + self.weights[edges].sum() + b
            for first, last in ends
            for s, a in sources
            for t, b in targets
            if (s, t) == (first, last)
        ]
        np.testing.assert_allclose(min(totals), cost, **SAME)


seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, FEW) | st.just(MANY)


@settings(max_examples=80)
@given(seeds, sizes)
def test_a_way_costs_what_scipy_says_and_is_one(seed, n):
    drawn = Drawn(seed, n)
    graph, costs = drawn.graph(), drawn.costs()
    for turn in range(8):
        if turn == 2:
            graph.prepare()
        sources, targets = drawn.ends(), drawn.ends()
        found = graph.shortest(sources, targets)
        drawn.check(found, sources, targets, drawn.cheapest(sources, targets, costs))


@settings(max_examples=25)
@given(seeds, sizes, st.sampled_from(["none", "weights", "half"]))
@example(0, MANY, "none")
def test_answers_stay_exact_while_weights_rise_and_fall(seed, n, least):
    drawn = Drawn(seed, n)
    lowest = {"none": None, "weights": drawn.weights, "half": drawn.weights / 2}[least]
    graph = drawn.graph(least=lowest)
    count = len(drawn.weights)
    for turn in range(6):
        if turn != 3:  # without landmarks where the last change took them
            graph.prepare()
        if count:
            edges = drawn.random.integers(0, count, drawn.random.integers(0, 5))
            weights = drawn.weight(len(edges))
            if turn % 2:  # a little less than before, or a little more
                weights = drawn.weights[edges] * drawn.random.uniform(0.85, 1.1, len(edges))
            graph.set_weights(edges, weights)
            for edge, weight in zip(edges, weights, strict=True):
                drawn.weights = drawn.weights.copy()
                drawn.weights[edge] = weight
            np.testing.assert_array_equal(graph.weights, drawn.weights)
        costs = drawn.costs()
        for _ in range(4):
            sources, targets = drawn.ends(), drawn.ends()
            expected = drawn.cheapest(sources, targets, costs)
            drawn.check(graph.shortest(sources, targets), sources, targets, expected)
        everywhere = np.arange(n)
        np.testing.assert_allclose(graph.distances(everywhere, everywhere), costs, **SAME)
        np.testing.assert_allclose(graph.distances(everywhere, [0]), costs[:, :1], **SAME)
        ways = graph.alternatives(sources, targets, 2)
        assert bool(ways) == math.isfinite(expected)
        for cost, _ in ways[:1]:
            np.testing.assert_allclose(cost, expected, **SAME)


@settings(max_examples=60)
@given(seeds, sizes, st.integers(0, 12), st.integers(0, 12))
def test_costs_between_many_are_those_of_scipy_with_any_number_of_threads(seed, n, a, b):
    drawn = Drawn(seed, n)
    graph = drawn.graph()
    sources, targets = drawn.random.integers(0, n, a), drawn.random.integers(0, n, b)
    expected = drawn.costs()[np.ix_(sources, targets)]
    found = graph.distances(sources, targets, threads=1)
    assert found.shape == (a, b)
    np.testing.assert_allclose(found, expected, **SAME)
    np.testing.assert_array_equal(graph.distances(sources, targets, threads=4), found)


def loopless(drawn, sources, targets):
    """The costs of all ways that pass no node twice, by brute force."""
    begin, end = {}, {}
    for ends, least in ((sources, begin), (targets, end)):
        for node, cost in ends:
            least[node] = min(cost, least.get(node, math.inf))
    costs = []

    def go(node, cost, passed):
        if node in end:
            costs.append(cost + end[node])
        for tail, head, weight in zip(drawn.tails, drawn.heads, drawn.weights, strict=True):
            if tail == node and head not in passed and math.isfinite(weight):
                go(head, cost + weight, passed | {head})

    for node, cost in begin.items():
        go(node, cost, {node})
    return sorted(costs)


@settings(max_examples=150)
@given(seeds, st.integers(1, 6), st.integers(0, 30))
def test_alternatives_are_the_cheapest_of_all_ways(seed, n, k):
    drawn = Drawn(seed, n)
    sources, targets = drawn.ends(), drawn.ends()
    expected = loopless(drawn, sources, targets)[:k]
    found = drawn.graph().alternatives(sources, targets, k)
    np.testing.assert_allclose([cost for cost, _ in found], expected, **SAME)
    assert [c for c, _ in found] == sorted(c for c, _ in found)
    for way in found:
        if len(way[1]):
            drawn.check(way, [(s, a) for s, a in sources], targets, way[0])
            nodes = [drawn.tails[way[1][0]], *drawn.heads[way[1]]]
            assert len(set(nodes)) == len(nodes)
    passed = [tuple(edges) for _, edges in found if len(edges)]
    assert len(set(passed)) == len(passed)


@settings(max_examples=8)
@given(seeds)
def test_alternatives_are_those_of_networkx(seed):
    random = np.random.default_rng(seed)
    lattice = nx.grid_2d_graph(15, 16, create_using=nx.DiGraph)
    lattice = nx.convert_node_labels_to_integers(lattice)
    edges = list(lattice.edges)
    weights = random.uniform(1, 2, len(edges))
    nx.set_edge_attributes(lattice, dict(zip(edges, weights.tolist(), strict=True)), "weight")
    graph = Graph(*np.transpose(edges), weights, lattice.number_of_nodes())  # type: ignore[call-arg]
    start, goal = random.choice(240, 2, replace=False).tolist()
    ways = itertools.islice(nx.shortest_simple_paths(lattice, start, goal, "weight"), 12)
    expected = [nx.path_weight(lattice, way, "weight") for way in ways]
    found = [cost for cost, _ in graph.alternatives([(start, 0.0)], [(goal, 0.0)], 12)]
    np.testing.assert_allclose(found, expected, **SAME)


def test_who_asks_while_a_door_shuts_is_told_of_before_or_after():
    drawn = Drawn(5, 400, closed=False)
    graph, costs = drawn.graph(), []
    ends = [drawn.random.integers(0, 400, 2).tolist() for _ in range(20)]
    doors = drawn.random.choice(len(drawn.weights), 300, replace=False)
    open_, shut = drawn.weights, drawn.weights.copy()
    shut[doors] = math.inf
    for drawn.weights in (open_, shut):
        costs.append(drawn.costs())
    assert any(costs[0][a, b] != costs[1][a, b] for a, b in ends)

    def ask(turn):
        a, b = ends[turn % len(ends)]
        found = graph.shortest([(a, 0.0)], [(b, 0.0)])
        between = graph.distances([a], [b])[0, 0]
        best = graph.alternatives([(a, 0.0)], [(b, 0.0)], 1)
        return a, b, [math.inf if found is None else found[0], between, *(c for c, _ in best)]

    with ThreadPoolExecutor(3) as pool:
        answers = pool.map(ask, range(600))
        for turn in range(200):
            graph.set_weights(doors, (shut if turn % 2 == 0 else open_)[doors])
        for a, b, found in answers:
            for cost in found:
                assert any(
                    cost == pytest.approx(known[a, b], rel=1e-12, abs=1e-12) for known in costs
                )


def lattice_of(rows, columns):
    """Tails and heads of steps to four neighbours, and how many nodes there are."""
    lattice = nx.grid_2d_graph(rows, columns, create_using=nx.DiGraph)
    return *np.transpose(list(nx.convert_node_labels_to_integers(lattice).edges)), rows * columns


def test_ways_that_hardly_differ_are_told_apart_though_bounds_are_in_single_precision():
    random = np.random.default_rng(8)
    tails, heads, n = lattice_of(20, 21)
    weights = 1 / 3 + 1e-9 * random.random(len(tails))
    graph = Graph(tails, heads, weights, n)
    graph.prepare()
    costs = dijkstra(coo_array((weights, (tails, heads)), shape=(n, n)).tocsr())
    for start, goal in random.integers(0, n, (200, 2)).tolist():
        cost, _ = graph.shortest([(start, 0.0)], [(goal, 0.0)])
        np.testing.assert_allclose(cost, costs[start, goal], **SAME)


def test_landmarks_are_computed_once_searches_without_have_cost_as_much():
    tails, heads, n = lattice_of(100, 100)
    graph = Graph(tails, heads, np.ones(len(tails)), n)
    without = median_seconds(graph)
    for _ in range(20):
        assert graph.shortest([(0, 0.0)], [(9_999, 0.0)])[0] == 198
    # one row: landmarks in the corners leave little to search
    assert median_seconds(graph) < without / 2


def median_seconds(graph):
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        assert graph.shortest([(0, 0.0)], [(99, 0.0)])[0] == 99
        seconds.append(time.perf_counter() - start)
    return sorted(seconds)[1]


def test_a_graph_without_edges_or_nodes_answers():
    assert Graph([], [], [], 0).distances([], []).shape == (0, 0)
    alone = Graph([], [], [], 300)
    assert alone.shortest([(3, 1.0)], [(4, 0.0)]) is None
    cost, edges = alone.shortest([(3, 1.0)], [(3, 0.5)])
    assert (cost, len(edges)) == (1.5, 0)
    assert alone.shortest([], [(3, 0.0)]) is None
    assert alone.shortest([(3, 0.0)], []) is None
    assert alone.shortest([(3, math.inf)], [(3, 0.0)]) is None
    assert alone.alternatives([(3, 0.0)], [(4, 0.0)], 5) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0], [1, 0], [1.0], 2), "1 tails, 2 heads"),
        (([0], [2], [1.0], 2), "heads: there is no node 2; nodes are 0 to 1"),
        (([-1], [1], [1.0], 2), "tails: there is no node -1"),
        (([0.5], [1], [1.0], 2), "tails: give a list of nodes, not float64"),
        (([0], [1], [-1.0], 2), "weights: number 0 is -1.0; give 0 or more"),
        (([0], [1], [math.nan], 2), "number 0 is nan"),
        (([], [], [], -1), "n_nodes"),
    ],
)
def test_what_is_no_graph_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Graph(*arguments)


def test_what_is_wrong_is_said_and_changes_nothing():
    graph = Graph([0, 1], [1, 2], [1.0, 2.0], 3)
    for edges, weights, message in (
        ([0, 2], [5.0, 5.0], "there is no edge 2; edges are 0 to 1"),
        ([0, 1], [5.0, -5.0], "number 1 is -5"),
        ([0, 1], [5.0], "there are 2 edges and 1 weights"),
    ):
        with pytest.raises(ValueError, match=message):
            graph.set_weights(edges, weights)
    np.testing.assert_array_equal(graph.weights, [1.0, 2.0])
    for ask in (graph.shortest, lambda a, b: graph.alternatives(a, b, 2)):
        with pytest.raises(ValueError, match="sources: there is no node 3; nodes are 0 to 2"):
            ask([(3, 0.0)], [(0, 0.0)])
        for cost in (-1.0, math.nan):
            with pytest.raises(ValueError, match="targets: the cost at node 0 is not negative"):
                ask([(2, 0.0)], [(0, cost)])
    with pytest.raises(ValueError, match="k is -1; give 0 or more"):
        graph.alternatives([(0, 0.0)], [(1, 0.0)], -1)
    with pytest.raises(ValueError, match="targets: there is no node 7"):
        graph.distances([0], [7])
    with pytest.raises(ValueError, match="threads is 0; give 1 or more"):
        graph.distances([0], [1], threads=0)
