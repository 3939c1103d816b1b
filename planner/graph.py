"""Shortest paths in a directed graph whose weights change while other threads search.

rustworkx, networkit and pgRouting take 10 to 1,000 times as long for a path among 25,600 rooms, and
rustworkx 10 times for a matrix of costs: ``python -m benchmarks routes``.

Why: docs/decisions/routes_are_found_by_a_with_landmarks_in_our_own_c_core.md
"""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

import semmap_native
from semmap.arrays import Floats, Ints

PathEnd = tuple[int, float]  # A node at which paths may begin or end, and the cost of doing so

GraphPath = tuple[float, Ints]
"""The cost of a path, its ends included, and its edges in order, (n,) int64."""


class Graph:
    """A directed graph. Edges may be parallel or closed, and change their weights at any time.

    A path is found by A* with lower bounds from landmarks, which are nodes far apart (Goldberg and
    Harrelson, Computing the shortest path: A* search meets graph theory, SODA 2005). Any number of
    threads may search while others set weights; each answer is exact for the weights before or
    after the change. Wrong arrays, unknown nodes, negative numbers and NaN are ValueErrors.

    Parameters
    ----------
    tails, heads
        (E,) whole numbers: the nodes from which and to which each edge leads.
    weights
        (E,) float64, not negative; infinity closes an edge.
    least
        (E,) float64: the lowest weight that each edge may get later; by default `weights`. Give it
        for edges that are closed now and may open. If a weight falls far below it, the landmarks
        become invalid, and paths are searched without landmarks until that has cost as much as
        computing new ones.

    Examples
    --------
    >>> graph = Graph([0, 1, 0], [1, 2, 2], [1.0, 1.0, 5.0], 3)
    >>> graph.shortest([(0, 0.0)], [(2, 0.5)])
    (2.5, array([0, 1]))
    >>> graph.set_weights([1], [np.inf])
    >>> graph.shortest([(0, 0.0)], [(2, 0.5)])
    (5.5, array([2]))
    """

    def __init__(
        self,
        tails: ArrayLike,
        heads: ArrayLike,
        weights: ArrayLike,
        n_nodes: int,
        *,
        least: ArrayLike | None = None,
    ) -> None:
        if not 0 <= n_nodes < 2**32 - 1:
            raise ValueError(f"n_nodes is {n_nodes}; give a number from 0 to {2**32 - 2}")
        self.n_nodes = n_nodes
        from_, to = self._nodes("tails", tails), self._nodes("heads", heads)
        costs = _weights("weights", weights)
        lowest = costs if least is None else _weights("least", least)
        if not len(from_) == len(to) == len(costs) == len(lowest):
            raise ValueError(
                f"each edge has a tail, a head and a weight, but there are {len(from_)} tails, "
                f"{len(to)} heads, {len(costs)} weights and {len(lowest)} least weights"
            )
        self.n_edges = len(costs)
        self._graph = semmap_native.Graph(from_, to, costs, lowest, n_nodes)

    @property
    def weights(self) -> Floats:
        """(E,) the present weights, a copy."""
        return self._graph.weights()

    def set_weights(self, edges: ArrayLike, weights: ArrayLike) -> None:
        """Change the weights of edges (n,): all of them, or none if an argument is invalid.

        Of an edge that is given twice, the last weight counts.
        """
        numbers = _numbers("edges", edges, self.n_edges, "edge")
        costs = _weights("weights", weights)
        if len(numbers) != len(costs):
            raise ValueError(f"there are {len(numbers)} edges and {len(costs)} weights")
        self._graph.set_weights(numbers, costs)

    def shortest(self, sources: Sequence[PathEnd], targets: Sequence[PathEnd]) -> GraphPath | None:
        """A cheapest path from any source to any target; None if there is none."""
        return self._graph.shortest(sources, targets)

    def alternatives(
        self, sources: Sequence[PathEnd], targets: Sequence[PathEnd], k: int
    ) -> list[GraphPath]:
        """The k cheapest paths that visit no node twice, the cheapest first, or all if fewer.

        Paths that differ only in a parallel edge, in a source or in a target count as two (Lawler,
        A procedure for computing the k best solutions to discrete optimization problems, 1972).
        """
        if k < 0:
            raise ValueError(f"k is {k}; give 0 or more")
        return self._graph.alternatives(sources, targets, k)

    def distances(
        self, sources: ArrayLike, targets: ArrayLike, *, threads: int | None = None
    ) -> Floats:
        """(n, m) float64 costs of the cheapest paths from n nodes to m; infinity: no path.

        There is by default one thread for each processor; the result does not depend on it.
        """
        from_, to = self._nodes("sources", sources), self._nodes("targets", targets)
        if threads is None:
            threads = len(os.sched_getaffinity(0))
        if threads < 1:
            raise ValueError(f"threads is {threads}; give 1 or more")
        return self._graph.distances(from_, to, threads)

    def prepare(self) -> None:
        """Compute the landmarks now, not only once searches have cost as much without them."""
        self._graph.prepare()

    def _nodes(self, name: str, value: ArrayLike) -> Ints:
        return _numbers(name, value, self.n_nodes, "node")


def _numbers(name: str, value: ArrayLike, count: int, what: str) -> Ints:
    numbers = np.asarray(value)
    if numbers.size == 0:
        return np.empty(0, np.int64)
    if numbers.ndim != 1 or not np.issubdtype(numbers.dtype, np.integer):
        raise ValueError(
            f"{name}: give a list of {what}s, not {numbers.dtype} of shape {numbers.shape}"
        )
    if numbers.min() < 0 or numbers.max() >= count:
        wrong = numbers[(numbers < 0) | (numbers >= count)][0]
        there = f"{what}s are 0 to {count - 1}" if count else f"there are no {what}s"
        raise ValueError(f"{name}: there is no {what} {wrong}; {there}")
    return np.ascontiguousarray(numbers, dtype=np.int64)


def _weights(name: str, value: ArrayLike) -> Floats:
    weights = np.ascontiguousarray(value, dtype=np.float64)
    if weights.ndim != 1:
        raise ValueError(f"{name}: give a list of numbers, not an array of shape {weights.shape}")
    if not (weights >= 0).all():
        i = int((~(weights >= 0)).argmax())
        raise ValueError(f"{name}: number {i} is {weights[i]}; give 0 or more, or infinity")
    return weights
