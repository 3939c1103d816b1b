"""Rectangular windows of a grid."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TypeAlias

import numpy as np

from navgrid.grid import Grid
from semmap.query.storey_scene import Bounds

Window: TypeAlias = tuple[slice, slice]
"""Rows and columns."""


def whole(grid: Grid) -> Window:
    """Return the window of all cells."""
    rows, columns = grid.shape
    return slice(0, rows), slice(0, columns)


def grown(window: Window, cells: int, grid: Grid) -> Window:
    """Return a window with a border of so many cells, as far as the grid reaches."""
    rows, columns = (
        slice(max(0, side.start - cells), min(size, side.stop + cells))
        for side, size in zip(window, grid.shape, strict=True)
    )
    return rows, columns


def common(a: Window, b: Window) -> Window | None:
    """Return the cells that two windows have in common; None for no cell."""
    rows, columns = (
        slice(max(x.start, y.start), min(x.stop, y.stop)) for x, y in zip(a, b, strict=True)
    )
    return (rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None


def seen_from(outer: Window, window: Window) -> Window:
    """Return a window as one of the cells of another that contains it."""
    rows, columns = (
        slice(w.start - o.start, w.stop - o.start) for w, o in zip(window, outer, strict=True)
    )
    return rows, columns


def window_around(rectangles: Iterable[Bounds], grid: Grid) -> Window | None:
    """Return the cells that rectangles (x0, y0, x1, y1), metres, may meet; None for no cell."""
    corners = [*rectangles]
    if not corners:
        return None
    low, high = np.min(corners, axis=0)[:2], np.max(corners, axis=0)[2:]
    found = []
    for axis in (1, 0):
        first, last = (
            math.floor((end[axis] - grid.origin[axis]) / grid.resolution) for end in (low, high)
        )
        size = grid.shape[1 - axis]
        if last + 1 < 0 or first - 1 >= size:
            return None
        found.append(slice(max(0, first - 1), min(size, last + 2)))
    return found[0], found[1]
