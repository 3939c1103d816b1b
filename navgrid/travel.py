"""Cheapest ways over a costmap: what driving from cell to cell costs, and where it leads."""

from __future__ import annotations

import math
import os

import numpy as np
from numpy.typing import ArrayLike, NDArray

import semmap_native

__all__ = ["DEAREST", "travel", "way"]

DEAREST = 1000.0
"""The largest `slow`."""


def travel(
    costs: ArrayLike,
    resolution: float,
    cells: ArrayLike,
    *,
    slow: float = 1.0,
    targets: ArrayLike | None = None,
    threads: int | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What the cheapest ways from cells to cells of a costmap cost, and how long they are.

    A step leads to one of 16 neighbours: the 8 around a cell and the 8 that a chess knight reaches.
    It is open where both cells and the two cells beside its line are below 253 (unknown, 255, is
    not). It costs its metres times the mean of ``1 + slow * cost / 252`` over its two cells. Prices
    are exact, in double precision: Dijkstra over buckets as wide as the cheapest step (Denardo and
    Fox, Shortest-route methods 1, Operations Research 27, 1979).

    Parameters
    ----------
    costs : (rows, columns) uint8 with the meaning of costmap_2d
    resolution : metres a cell
    cells : (k, 2) rows and columns from which the ways lead
    slow : how much dearer the last passable cells are than free ones, 0 to `DEAREST`
    targets : (m, 2) rows and columns to which the ways lead; the same cells where None
    threads : by default one a processor; all numbers of them give the same

    Returns
    -------
    prices, metres : (k, m) float64
        Infinity where no way leads, or where one of the two cells is itself not passable. Prices
        are metres of free cells: divided by a speed they are seconds.

    Raises
    ------
    ValueError
        Arrays of another shape or type, cells outside of the costmap, numbers out of range.

    Examples
    --------
    >>> costs = np.array([[0, 0, 0], [0, 254, 0]], dtype=np.uint8)
    >>> prices, metres = travel(costs, 0.5, [(1, 0), (1, 2)])
    >>> metres[0]
    array([0., 2.])
    """
    ground = _costs(costs)
    _check(resolution, slow)
    starts = _cells("cells", cells, ground)
    goals = None if targets is None else _cells("targets", targets, ground)
    if threads is None:
        threads = len(os.sched_getaffinity(0))
    if threads < 1:
        raise ValueError(f"threads is at least 1, not {threads}")
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
    """The cells of the cheapest way from a cell to another, priced as by `travel`.

    Parameters
    ----------
    costs : (rows, columns) uint8 with the meaning of costmap_2d
    resolution : metres a cell
    start, goal : (row, column)
    slow : how much dearer the last passable cells are than free ones, 0 to `DEAREST`

    Returns
    -------
    (N, 2) int64 rows and columns, both ends included; None where no way leads there.

    Raises
    ------
    ValueError
        As by `travel`.
    """
    ground = _costs(costs)
    _check(resolution, slow)
    ends = (
        _cells(name, np.asarray(cell)[np.newaxis], ground)
        for name, cell in (("start", start), ("goal", goal))
    )
    found = semmap_native.way(ground, resolution, np.concatenate([*ends]), slow)
    return found if len(found) else None


def _costs(value: ArrayLike) -> NDArray[np.uint8]:
    costs = np.asarray(value)
    if costs.ndim != 2 or costs.dtype != np.uint8:
        raise ValueError(
            f"costs is a (rows, columns) array of uint8, not {costs.dtype} of shape {costs.shape}"
        )
    return np.ascontiguousarray(costs)


def _cells(name: str, value: ArrayLike, costs: NDArray[np.uint8]) -> NDArray[np.int64]:
    cells = np.asarray(value)
    if cells.size == 0:
        return np.empty((0, 2), np.int64)
    if cells.ndim != 2 or cells.shape[1] != 2 or not np.issubdtype(cells.dtype, np.integer):
        raise ValueError(
            f"{name}: rows and columns are whole numbers, not {cells.dtype} of shape {cells.shape}"
        )
    outside = ((cells < 0) | (cells >= costs.shape)).any(axis=1)
    if outside.any():
        row, column = cells[outside.argmax()].tolist()
        raise ValueError(
            f"{name}: ({row}, {column}) is outside of the costmap of {costs.shape[0]} rows and "
            f"{costs.shape[1]} columns; leave it out or take a larger costmap"
        )
    return np.ascontiguousarray(cells, dtype=np.int64)


def _check(resolution: float, slow: float) -> None:
    if not (math.isfinite(resolution) and resolution > 0):
        raise ValueError(f"resolution is finite and above 0, not {resolution}")
    if not 0 <= slow <= DEAREST:
        raise ValueError(f"slow is 0 to {DEAREST:g}, not {slow}")
