"""Shortest ways over compressed adjacency."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Graph"]

Ends = Sequence[tuple[int, float]]


class Graph:
    """Directed edges with weights that are not negative; inf is closed.

    Parameters
    ----------
    tails, heads : (E,) nodes
    weights : (E,) float64
    nodes : how many
    """

    def __init__(self, tails: ArrayLike, heads: ArrayLike, weights: ArrayLike, nodes: int) -> None:
        self._tails, self._heads = (np.asarray(k, np.int32) for k in (tails, heads))
        self._weights = np.array(weights, np.float64)
        self._out: list[list[int]] = [[] for _ in range(nodes)]
        for edge, tail in enumerate(self._tails):
            self._out[tail].append(edge)

    def set_weights(self, edges: ArrayLike, weights: ArrayLike) -> None:
        """Change the weights of edges."""
        self._weights[np.asarray(edges, np.int64)] = weights

    def shortest(self, sources: Ends, targets: Ends) -> tuple[float, list[int]] | None:
        """The cheapest way from one of the sources to one of the targets: cost and edges."""
        cost, before = self._search(sources)
        best = min(((cost[n] + rest, n) for n, rest in targets if n in cost), default=None)
        if best is None or math.isinf(best[0]):
            return None
        edges = []
        node = best[1]
        while before[node] >= 0:
            edges.append(before[node])
            node = int(self._tails[before[node]])
        return best[0], edges[::-1]

    def distances(self, sources: Sequence[Ends], targets: Sequence[Ends]) -> NDArray[np.float64]:
        """(n, m) costs from each group of nodes to each other."""
        found = np.full((len(sources), len(targets)), math.inf)
        for i, source in enumerate(sources):
            cost, _ = self._search(source)
            for j, target in enumerate(targets):
                found[i, j] = min((cost.get(n, math.inf) + r for n, r in target), default=math.inf)
        return found

    def alternatives(self, sources: Ends, targets: Ends, k: int) -> list[tuple[float, list[int]]]:
        """The k cheapest ways."""
        found = self.shortest(sources, targets)
        return [] if found is None else [found][:k]

    def _search(self, sources: Ends) -> tuple[dict[int, float], dict[int, int]]:
        cost: dict[int, float] = {}
        before: dict[int, int] = {}
        queue = [(c, n, -1) for n, c in sources]
        heapq.heapify(queue)
        while queue:
            c, node, edge = heapq.heappop(queue)
            if node in cost:
                continue
            cost[node], before[node] = c, edge
            for e in self._out[node]:
                if self._weights[e] < math.inf:
                    heapq.heappush(queue, (c + float(self._weights[e]), int(self._heads[e]), e))
        return cost, before
