"""The cheapest paths over a costmap: their costs, lengths and cells."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import ArrayLike, NDArray

import semmap_native

DEAREST = 1000.0
"""The largest value of `slow`."""


def travel(
    costs: ArrayLike,
    resolution: float,
    cells: ArrayLike,
    *,
    slow: float = 1.0,
    targets: ArrayLike | None = None,
    threads: int | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (k, m) costs and lengths of the cheapest paths between cells; infinity: no path.

    A step leads to one of 16 neighbours: the 8 around a cell and the 8 at a knight's move. It is
    passable if both its cells and the two cells beside its line are below 253 (unknown, 255, is
    not). It costs its metres times the mean of ``1 + slow * cost / 252`` over its two cells, with
    `slow` from 0 to `DEAREST`: divided by a speed, costs are seconds. They are exact, in double
    precision: Dijkstra over buckets as wide as the cheapest step (Denardo and Fox, Shortest-route
    methods 1, Operations Research 27, 1979). Cells and targets (by default the cells) are rows and
    columns; ValueError for one that is outside. Threads, by default one a processor, change
    nothing.

    >>> costs = np.array([[0, 0, 0], [0, 254, 0]], dtype=np.uint8)
    >>> prices, metres = travel(costs, 0.5, [(1, 0), (1, 2)])
    >>> metres[0]
    array([0., 2.])
    """
    ground = _costs(costs)
    _check_slow(slow)
    starts = _cells("cells", cells)
    goals = None if targets is None else _cells("targets", targets)
    if threads is None:
        threads = len(os.sched_getaffinity(0))
    if threads < 1:
        raise ValueError(f"threads is {threads}; give 1 or more")
    used = min(threads, max(len(starts), 1))
    return semmap_native.travel(ground, resolution, starts, slow, goals, used)


def way(
    costs: ArrayLike,
    resolution: float,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    slow: float = 1.0,
) -> NDArray[np.int64] | None:
    """Return the (N, 2) cells of the cheapest path of `travel` between two; None without one."""
    ground = _costs(costs)
    _check_slow(slow)
    ends = (
        _cells(name, np.asarray(cell)[np.newaxis])
        for name, cell in (("start", start), ("goal", goal))
    )
    found = semmap_native.way(ground, resolution, np.concatenate([*ends]), slow)
    return found if len(found) else None


def _costs(value: ArrayLike) -> NDArray[np.uint8]:
    costs = np.asarray(value)
    if costs.ndim != 2 or costs.dtype != np.uint8:
        raise ValueError(
            f"costs is {costs.dtype} of shape {costs.shape}; give a (rows, columns) array of uint8"
        )
    return np.ascontiguousarray(costs)


def _cells(name: str, value: ArrayLike) -> NDArray[np.int64]:
    cells = np.asarray(value)
    if cells.size == 0:
        return np.empty((0, 2), np.int64)
    if cells.ndim != 2 or cells.shape[1] != 2 or not np.issubdtype(cells.dtype, np.integer):
        raise ValueError(
            f"{name} is {cells.dtype} of shape {cells.shape}; give (n, 2) whole numbers"
        )
    return np.ascontiguousarray(cells, dtype=np.int64)


def _check_slow(slow: float) -> None:
    if not 0 <= slow <= DEAREST:
        raise ValueError(f"slow is {slow}; give 0 to {DEAREST:g}")
