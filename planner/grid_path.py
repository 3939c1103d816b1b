"""The way on a grid between two points: short, and clear of what is occupied where it can be."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from navgrid.grid import Grid
from navgrid.travel import way
from semmap.arrays import Floats

_DEAR = 6.0  # how much dearer a cell beside an obstacle is than one that is clear


def grid_path(
    grid: Grid,
    cells: NDArray[np.int8],
    start: tuple[float, float],
    goal: tuple[float, float],
    clearance: float = 0.45,
) -> Floats | None:
    """(N, 2) the cheapest way between two points, metres, straightened; None without a way.

    `cells` (rows, columns) int8 are 100 where occupied, 0 where free, and -1 where unknown, which
    is passed, too. The ends count as the nearest cell that is not occupied. Cells nearer to what is
    occupied than `clearance`, metres, are dearer.
    """
    passable = np.asarray(cells) < 50
    if not passable.any():
        return None
    distance = np.asarray(distance_transform_edt(passable)) * grid.resolution
    price = 1.0 + _DEAR * np.clip(1.0 - distance / clearance, 0.0, 1.0) ** 2
    costs = np.where(passable, np.rint(252 * (price - 1.0) / _DEAR), 254).astype(np.uint8)
    ends = (_nearest(grid, passable, p) for p in (start, goal))
    found = way(costs, grid.resolution, *ends, slow=_DEAR)
    if found is None:
        return None
    kept = _straightened(found, price)
    points = np.array(grid.origin) + (kept[:, ::-1] + 0.5) * grid.resolution
    return np.concatenate([[start], points[1:-1], [goal]])


def _nearest(
    grid: Grid, passable: NDArray[np.bool_], point: tuple[float, float]
) -> tuple[int, int]:
    rows, columns = np.nonzero(passable)
    at = (np.array(point) - grid.origin) / grid.resolution - 0.5
    i = int(np.argmin((columns - at[0]) ** 2 + (rows - at[1]) ** 2))
    return int(rows[i]), int(columns[i])


def _straightened(cells: NDArray[np.int64], price: Floats) -> Floats:
    """The cells at which a way has to bend: no straight line is taken that is dearer than it."""
    spent = np.concatenate([[0.0], np.cumsum([_price(price, a, b) for a, b in pairwise(cells)])])
    kept = [0]
    while kept[-1] < len(cells) - 1:
        here = kept[-1]
        there = len(cells) - 1
        while there > here + 1:
            direct = _price(price, cells[here], cells[there])
            if direct <= 1.02 * (spent[there] - spent[here]):
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
