"""The way on a grid between two points: short, and clear of what is occupied where it can be."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from navgrid.grid import Grid

__all__ = ["grid_path"]

Floats = NDArray[np.float64]
_DEAR = 6.0  # how much dearer a cell beside an obstacle is than one that is clear


def grid_path(
    grid: Grid,
    cells: NDArray[np.int8],
    start: tuple[float, float],
    goal: tuple[float, float],
    clearance: float = 0.45,
) -> Floats | None:
    """The cheapest way between two points through cells that are not occupied.

    Parameters
    ----------
    cells : (rows, columns) int8: 100 occupied, 0 free, -1 unknown, which is passed, too
    start, goal : (x, y) in metres; each begins at the nearest cell that is not occupied
    clearance : distance from what is occupied below which a cell is dearer, metres

    Returns
    -------
    (N, 2) points from start to goal, straightened; None where no way leads there.
    """
    passable = np.asarray(cells) < 50
    if not passable.any():
        return None
    distance = np.asarray(distance_transform_edt(passable)) * grid.resolution
    price = 1.0 + _DEAR * np.clip(1.0 - distance / clearance, 0.0, 1.0) ** 2
    graph = _neighbours(passable, price)
    source, target = (_nearest(grid, passable, p) for p in (start, goal))
    cost, before = dijkstra(graph, directed=True, indices=[source], return_predecessors=True)
    cost, before = cost[0], before[0]
    if not np.isfinite(cost[target]):
        return None
    chain = [target]
    while chain[-1] != source:
        chain.append(int(before[chain[-1]]))
    rows, columns = np.unravel_index(np.array(chain[::-1]), grid.shape)
    kept = _straightened(np.stack([rows, columns], axis=1), price)
    points = np.array(grid.origin) + (kept[:, ::-1] + 0.5) * grid.resolution
    return np.concatenate([[start], points[1:-1], [goal]])


def _neighbours(passable: NDArray[np.bool_], price: Floats) -> csr_array:
    """Steps between neighbouring cells, eight a cell, not around corners of what is occupied."""
    index = np.arange(passable.size).reshape(passable.shape)
    heads, tails, costs = [], [], []
    rows, columns = passable.shape
    for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = (slice(0, rows - dr), slice(max(0, -dc), columns - max(0, dc)))
        b = (slice(dr, rows), slice(max(0, dc), columns + min(0, dc)))
        free = passable[a] & passable[b]
        if dr and dc:
            beside = (a[0], b[1])
            above = (b[0], a[1])
            free &= passable[beside] & passable[above]
        heads.append(index[a][free])
        tails.append(index[b][free])
        costs.append(np.hypot(dr, dc) * (price[a] + price[b])[free] / 2)
    head, tail, cost = (np.concatenate(part) for part in (heads, tails, costs))
    both = (np.concatenate([head, tail]), np.concatenate([tail, head]))
    return coo_array((np.concatenate([cost, cost]), both), shape=(passable.size,) * 2).tocsr()


def _nearest(grid: Grid, passable: NDArray[np.bool_], point: tuple[float, float]) -> int:
    rows, columns = np.nonzero(passable)
    at = (np.array(point) - grid.origin) / grid.resolution - 0.5
    i = int(np.argmin((columns - at[0]) ** 2 + (rows - at[1]) ** 2))
    return int(np.ravel_multi_index((rows[i], columns[i]), passable.shape))


def _straightened(cells: NDArray[np.int64], price: Floats) -> Floats:
    """The cells at which a way has to bend: no straight line is taken that is dearer than it."""
    way = np.concatenate([[0.0], np.cumsum([_price(price, a, b) for a, b in pairwise(cells)])])
    kept = [0]
    while kept[-1] < len(cells) - 1:
        here = kept[-1]
        there = len(cells) - 1
        while there > here + 1:
            direct = _price(price, cells[here], cells[there])
            if direct <= 1.02 * (way[there] - way[here]):
                break
            there -= max(1, (there - here) // 12)
        kept.append(max(there, here + 1))
    found: Floats = cells[kept].astype(float)
    return found


def _price(price: Floats, a: NDArray[np.int64], b: NDArray[np.int64]) -> float:
    """The price of a straight line between two cells; occupied cells have the highest."""
    n = int(np.ceil(2 * np.hypot(*(b - a)))) + 1
    line = np.rint(a + (b - a) * np.linspace(0, 1, n)[:, None]).astype(int)
    at = price[line[:, 0], line[:, 1]]
    if (at >= 1.0 + _DEAR).any():
        return float("inf")
    return float(np.mean(at) * np.hypot(*(b - a)))
