"""Finds where the layered costmap knows a way that a costmap of the whole robot does not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label

from navgrid.grid import Grid
from navgrid.inflation import INSCRIBED

Point = tuple[float, float]

SMALLEST = 0.1
"""Square metres of free floor below which a part of a room is neither start nor goal."""


class HiddenPassage(NamedTuple):
    """Two points, (x, y) in metres, that only the layered costmap joins."""

    start: Point
    goal: Point


def find_passage(
    layered: NDArray[np.uint8], single: NDArray[np.uint8], grid: Grid
) -> HiddenPassage | None:
    """The largest area that only the layered costmap reaches, with a start outside of it.

    The goal is in another part of the floor that is free for the whole robot, or else deep in the
    area below or above furniture. `layered` and `single` are (rows, columns) costs for the robot as
    parts, and as one part of its whole height.
    """
    joined, _ = label(layered < INSCRIBED)
    apart, _ = label(single < INSCRIBED)
    hidden, count = label((layered < INSCRIBED) & (single >= INSCRIBED))
    sizes = np.bincount(hidden.ravel(), minlength=count + 1)
    for number in np.argsort(-sizes[1:]) + 1:
        if sizes[number] * grid.resolution**2 < SMALLEST:
            break
        found = _ends(hidden == number, joined, apart, grid.resolution)
        if found is not None:
            return HiddenPassage(*(_middle(grid, cell) for cell in found))
    return None


def _ends(
    area: NDArray[np.bool_], joined: NDArray[np.int32], apart: NDArray[np.int32], resolution: float
) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """The cells of start and goal, for an area that only the layered costmap has."""
    inside = joined[area][0]
    sizes = np.bincount(apart[joined == inside])
    sizes[0] = 0
    parts = [n for n in np.argsort(-sizes) if sizes[n] * resolution**2 >= SMALLEST]
    if not parts:
        return None
    away = np.asarray(distance_transform_edt(~area))
    start = _nearest(apart == parts[0], away)
    others = [n for n in parts[1:] if away[apart == n].min() < 2]
    return start, _deepest(apart == others[0] if others else area)


def _deepest(cells: NDArray[np.bool_]) -> tuple[int, int]:
    """The cell of an area that is farthest from its border."""
    depth = np.asarray(distance_transform_edt(np.pad(cells, 1)))[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(depth)), cells.shape)
    return int(row), int(column)


def _nearest(cells: NDArray[np.bool_], away: NDArray[np.float64]) -> tuple[int, int]:
    """A clear cell of a part of the floor, near to the area."""
    depth = np.minimum(np.asarray(distance_transform_edt(cells)), 8)
    score = np.where(cells, depth - 0.2 * away, -np.inf)
    row, column = np.unravel_index(int(np.argmax(score)), cells.shape)
    return int(row), int(column)


def _middle(grid: Grid, cell: tuple[int, int]) -> Point:
    x, y = (o + (c + 0.5) * grid.resolution for o, c in zip(grid.origin, cell[::-1], strict=True))
    return float(x), float(y)
