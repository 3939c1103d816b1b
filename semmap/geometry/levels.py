"""Heights at which furniture stands above furniture, as on the storeys of a building."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from semmap.arrays import Floats
from semmap.geometry.overlay import common

APART = 2.0
"""Least height from a floor to the next, metres."""

SLAB = 0.5
"""Largest thickness of a floor, metres."""

CONTACT = 0.1
"""Metres between a floor and the bottom of what stands on it."""

WALKED, WIDE = 12.0, 2.4
"""Least area and width of a floor, metres: those of a small room. Shelves are narrower."""

FURNITURE, TALL = 0.3, 0.6
"""Least height of furniture, and of what is seldom a lamp or a device under the ceiling, metres."""

SHARED = 0.5
"""Square metres that rooms one above the other share at least: more than the sides of walls."""

THIN, TOUCH = 0.5, 0.02
"""Metres of the narrow side of a lintel, at most, and from it to the wall beside it."""

MANY, FEW = 3, 2
"""So many pieces of furniture at one height may stand on a floor; so many, if they are tall."""


def is_furniture(boxes: Floats) -> NDArray[np.bool_]:
    """Return (N,) bool: which boxes (N, 2, 3) are as high as furniture, and narrower than walls."""
    sizes = boxes[:, 1] - boxes[:, 0]
    return np.asarray((sizes[:, 2] >= FURNITURE) & (sizes[:, :2].min(axis=1) < APART))


def standing_levels(
    boxes: Floats, floors: NDArray[np.bool_], parts: NDArray[np.bool_] | None = None
) -> list[float]:
    """Return the heights at which several pieces of furniture stand, lowest first, `APART` or more.

    Boxes (N, 2, 3) are all objects of a world, metres; `floors` (N,) which are floors, and `parts`
    which are walls or the like. What stands on other objects shows no level: the second board of a
    rack, a stack of pallets. Nor do lintels.
    """
    shows = is_furniture(boxes) & ~_is_stacked(boxes, np.flatnonzero(~floors)) & ~_is_lintel(boxes)
    standing = boxes[shows if parts is None else shows & ~parts]
    bottoms, tall = standing[:, 0, 2], np.ptp(standing[:, :, 2], axis=1) >= TALL
    found = []
    for z in np.unique(np.round(bottoms, 3)):
        here = np.abs(bottoms - z) <= CONTACT / 2
        if here.sum() >= MANY or (here & tall).sum() >= FEW:
            found.append(float(z))
    return separate(found)


def are_floors(boxes: Floats) -> NDArray[np.bool_]:
    """Return (N,) bool: which boxes (N, 2, 3) are as flat, large and wide as floors."""
    sizes = boxes[:, 1] - boxes[:, 0]
    wide = sizes[:, :2].min(axis=1) >= WIDE
    return np.asarray((sizes[:, 2] <= SLAB) & wide & (sizes[:, :2].prod(axis=1) >= WALKED))


def _is_stacked(boxes: Floats, bears: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which boxes stand on one of those that bear."""
    (x0, y0, _), (x1, y1, _) = np.moveaxis(boxes[bears], 0, -1)
    tree = shapely.STRtree(shapely.box(x0, y0, x1, y1))
    middles = shapely.points(boxes[:, :, :2].mean(axis=1))
    above, below = tree.query(middles, predicate="intersects")
    below = bears[below]
    rests = np.abs(boxes[above, 0, 2] - boxes[below, 1, 2]) <= CONTACT
    found = np.zeros(len(boxes), np.bool_)
    found[above[rests & (above != below)]] = True
    return found


def _is_lintel(boxes: Floats) -> NDArray[np.bool_]:
    """Which boxes are thin, beside one that begins lower by `TALL`, and reaches as high."""
    (x0, y0, low), (x1, y1, high) = np.moveaxis(boxes, 0, -1)
    found = np.zeros(len(boxes), np.bool_)
    thin = np.flatnonzero((boxes[:, 1] - boxes[:, 0])[:, :2].min(axis=1) <= THIN)
    tree = shapely.STRtree(shapely.box(x0, y0, x1, y1))
    around = shapely.box(x0 - TOUCH, y0 - TOUCH, x1 + TOUCH, y1 + TOUCH)[thin]
    number, beside = tree.query(around, predicate="intersects")
    over = thin[number]
    found[over[(low[beside] <= low[over] - TALL) & (high[beside] >= high[over] - TOUCH)]] = True
    return found


def separate(heights: Sequence[float] | Floats) -> list[float]:
    """Return the heights, lowest first: of a slab its top, and none less than `APART` above one."""
    kept: list[float] = []
    for height in np.round(sorted(heights), 3):
        if kept and height - kept[-1] <= SLAB:
            kept[-1] = float(height)
        elif not kept or height - kept[-1] >= APART:
            kept.append(float(height))
    return kept


def stacked(outlines: Sequence[shapely.Geometry], floors: Sequence[float]) -> list[int]:
    """Return the numbers of rooms above or below another of them, by `APART` or more, in order."""
    tree, heights = shapely.STRtree(outlines), np.asarray(floors, float)
    one, two = tree.query(np.asarray(outlines, object), predicate="intersects")
    apart = np.abs(heights[one] - heights[two]) >= APART
    return sorted(
        {
            int(n)
            for a, b in zip(one[apart], two[apart], strict=True)
            for n in (a, b)
            if common(outlines[a], outlines[b]).area >= SHARED
        }
    )


def in_metres(levels: Sequence[float]) -> str:
    """Return heights as words.

    >>> in_metres([0, 3, 6.25])
    '0, 3, 6.25 m'
    """
    return ", ".join(f"{level:g}" for level in levels) + " m"
