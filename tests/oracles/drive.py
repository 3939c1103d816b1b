"""The cheapest drives of a shape along its heading, by SciPy; another search than `navgrid`'s."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from navgrid.headings import MOVES, DriveSpace


def scipy_prices(
    costs: NDArray[np.uint8],
    space: DriveSpace,
    resolution: float,
    slow: float,
    start: tuple[int, int],
) -> NDArray[np.float64]:
    """(rows, columns) the least price of any heading, by Dijkstra over all cells and headings."""
    rows, columns = costs.shape
    tails, heads, prices = [], [], []

    def number(r: int, c: int, h: int) -> int:
        return (r * columns + c) * 16 + h

    def is_open(r: int, c: int) -> bool:
        return 0 <= r < rows and 0 <= c < columns and costs[r, c] != 255

    def stands(r: int, c: int, h: int) -> bool:
        return is_open(r, c) and bool(space.fits[r, c] >> h & 1)

    for r, c, h in np.ndindex(rows, columns, 16):
        if not stands(r, c, h):
            continue
        g = (h + 1) % 16
        if stands(r, c, g) and space.turns[r, c] >> h & 1:
            tails.append(number(r, c, h))
            heads.append(number(r, c, g))
            prices.append(1e-12)
        dr, dc = MOVES[h]
        if not stands(r + dr, c + dc, h) or not space.steps[r, c] >> h & 1:
            continue
        beside = [(r + dr, c), (r, c + dc)]
        if abs(dr) == 2:
            beside = [(r + dr // 2, c), (r + dr // 2, c + dc)]
        if abs(dc) == 2:
            beside = [(r, c + dc // 2), (r + dr, c + dc // 2)]
        if all(is_open(*cell) for cell in beside):
            mean = sum(min(int(costs[q]), 252) for q in ((r, c), (r + dr, c + dc))) / 2
            tails.append(number(r, c, h))
            heads.append(number(r + dr, c + dc, h))
            prices.append(math.hypot(dr, dc) * resolution * (1 + slow * mean / 252))
    graph = coo_matrix((prices, (tails, heads)), shape=(costs.size * 16,) * 2).tocsr()
    begin = [number(*start, h) for h in range(16) if stands(*start, h)]
    if not begin:
        return np.full(costs.shape, math.inf)
    found = dijkstra(graph, directed=False, indices=begin, min_only=True)
    return found.reshape(rows, columns, 16).min(axis=2)
