"""The definition of an occupied cell in rational arithmetic: nothing is rounded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from navgrid.grid import Grid

Point = tuple[Fraction, ...]


def halved(points: set[Point], height: Callable[[Point], Fraction]) -> set[Point]:
    """Points whose convex hull is the part of the hull of `points` where height is not negative."""
    kept = {p for p in points if height(p) >= 0}
    for p, q in combinations(points, 2):
        above, below = height(p), height(q)
        if above * below < 0:
            share = above / (above - below)
            kept.add(tuple(a + share * (b - a) for a, b in zip(p, q, strict=True)))
    return kept


def occupied(
    triangle: Sequence[Sequence[float]], interval: tuple[float, float], grid: Grid
) -> NDArray[np.bool_]:
    """(rows, columns) bool: the cells whose half-open square meets triangle ∩ slab, projected."""
    low, high = (Fraction(v) for v in interval)
    corners: set[Point] = {tuple(Fraction(float(v)) for v in p) for p in triangle}
    slab = halved(halved(corners, lambda p: p[2] - low), lambda p: high - p[2])
    projected: set[Point] = {p[:2] for p in slab}
    x, y = (
        [Fraction(float(origin) + i * float(grid.resolution)) for i in range(count + 1)]
        for origin, count in zip(grid.origin, grid.shape[::-1], strict=True)
    )
    cells = np.zeros(grid.shape, bool)
    for r in range(grid.shape[0]):
        bottom, top = y[r], y[r + 1]
        row = halved(halved(projected, lambda p, y=bottom: p[1] - y), lambda p, y=top: y - p[1])
        for c in range(grid.shape[1]):
            left, right = x[c], x[c + 1]
            part = halved(halved(row, lambda p, x=left: p[0] - x), lambda p, x=right: x - p[0])
            # Of two points, one below the upper border and one left of the right one, the middle
            # is both: the closed square's part is convex.
            cells[r, c] = (
                bool(part) and min(p[0] for p in part) < right and min(p[1] for p in part) < top
            )
    return cells
