"""Cheapest routes over a directed graph whose weights change while it is asked."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

import semmap_native

__all__ = ["End", "Graph", "Way"]

End = tuple[int, float]
"""A node at which ways begin or end, and what that costs."""

Way = tuple[float, NDArray[np.int64]]
"""What a way costs, its ends included, and the edges that it passes in order, (n,) int64."""

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


class Graph:
    """A directed graph; edges may be parallel, closed, and given other weights at any time.

    One way is found by A* with lower bounds from landmarks, which are nodes far apart (Goldberg and
    Harrelson, Computing the shortest path: A* search meets graph theory, SODA 2005). Any number of
    threads may ask while others set weights; each answer is exact for the weights before or after.

    Parameters
    ----------
    tails, heads : (E,) whole numbers, the nodes from which and to which each edge leads
    weights : (E,) float64, not negative; infinity where an edge is closed
    n_nodes : how many nodes there are
    least : (E,) float64
        What no weight will fall below; the weights where None. Say it of an edge that is closed now
        and may open: where a weight does fall far below, the landmarks are computed anew, and the
        next way waits for them (some 4 ms at 1,000 nodes).

    Raises
    ------
    ValueError
        Arrays of different lengths or other types, nodes that are not there, weights that are
        negative or no numbers.

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
            raise ValueError(f"n_nodes is 0 to {2**32 - 2}, not {n_nodes}")
        self.n_nodes = n_nodes
        from_, to = self._nodes("tails", tails), self._nodes("heads", heads)
        costs = _weights("weights", weights)
        lowest = costs if least is None else _weights("least", least)
        if not len(from_) == len(to) == len(costs) == len(lowest):
            raise ValueError(
                f"an edge is a tail, a head and a weight, but there are {len(from_)} tails, "
                f"{len(to)} heads, {len(costs)} weights and {len(lowest)} least weights"
            )
        self.n_edges = len(costs)
        self._graph = semmap_native.Graph(from_, to, costs, lowest, n_nodes)

    @property
    def weights(self) -> Floats:
        """(E,) what the edges cost now, a copy."""
        return self._graph.weights()

    def set_weights(self, edges: ArrayLike, weights: ArrayLike) -> None:
        """Give edges other weights: all of them, or none where a ValueError says why.

        Parameters
        ----------
        edges : (n,) whole numbers; the last counts where one comes twice
        weights : (n,) float64, not negative; infinity closes an edge
        """
        numbers = _numbers("edges", edges, self.n_edges, "edge")
        costs = _weights("weights", weights)
        if len(numbers) != len(costs):
            raise ValueError(f"{len(numbers)} edges are given {len(costs)} weights")
        self._graph.set_weights(numbers, costs)

    def shortest(self, sources: Sequence[End], targets: Sequence[End]) -> Way | None:
        """A cheapest way from any of the sources to any of the targets; None where none leads.

        Raises
        ------
        ValueError
            Nodes that are not there, costs that are negative or no numbers.
        """
        return self._graph.shortest(sources, targets)

    def alternatives(self, sources: Sequence[End], targets: Sequence[End], k: int) -> list[Way]:
        """The k cheapest ways that pass no node twice, the cheapest first; fewer where there are.

        Ways that differ in a parallel edge, or in a source or target alone, are two (Lawler, A
        procedure for computing the k best solutions to discrete optimization problems, 1972).

        Raises
        ------
        ValueError
            As by `shortest`; k below 0.
        """
        if k < 0:
            raise ValueError(f"k is not negative, but {k}")
        return self._graph.alternatives(sources, targets, k)

    def distances(
        self, sources: ArrayLike, targets: ArrayLike, *, threads: int | None = None
    ) -> Floats:
        """What the cheapest ways cost between many nodes.

        Parameters
        ----------
        sources, targets : (n,), (m,) nodes
        threads : by default one a processor; all numbers of them give the same

        Returns
        -------
        (n, m) float64, infinity where no way leads

        Raises
        ------
        ValueError
            Nodes that are not there; no thread.
        """
        from_, to = self._nodes("sources", sources), self._nodes("targets", targets)
        if threads is None:
            threads = len(os.sched_getaffinity(0))
        if threads < 1:
            raise ValueError(f"threads is at least 1, not {threads}")
        return self._graph.distances(from_, to, threads)

    def prepare(self) -> None:
        """Compute the landmarks now, for which the first way would wait."""
        self._graph.prepare()

    def _nodes(self, name: str, value: ArrayLike) -> Ints:
        return _numbers(name, value, self.n_nodes, "node")


def _numbers(name: str, value: ArrayLike, count: int, what: str) -> Ints:
    numbers = np.asarray(value)
    if numbers.size == 0:
        return np.empty(0, np.int64)
    if numbers.ndim != 1 or not np.issubdtype(numbers.dtype, np.integer):
        raise ValueError(
            f"{name} is a list of {what}s, not {numbers.dtype} of shape {numbers.shape}"
        )
    if numbers.min() < 0 or numbers.max() >= count:
        wrong = numbers[(numbers < 0) | (numbers >= count)][0]
        there = f"{what}s are 0 to {count - 1}" if count else f"there are no {what}s"
        raise ValueError(f"{name}: there is no {what} {wrong}; {there}")
    return np.ascontiguousarray(numbers, dtype=np.int64)


def _weights(name: str, value: ArrayLike) -> Floats:
    weights = np.ascontiguousarray(value, dtype=np.float64)
    if weights.ndim != 1:
        raise ValueError(f"{name} is a list of numbers, not of shape {weights.shape}")
    if not (weights >= 0).all():
        i = int((~(weights >= 0)).argmax())
        raise ValueError(f"{name} are not negative, and numbers: that of {i} is {weights[i]}")
    return weights
