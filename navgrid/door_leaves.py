"""Open leaves of doors in an occupancy grid: thin lines that end in free space.

A wall ends so, too. A leaf is as long as the doorway at its hinge is wide: the wall goes on behind
the hinge, and ends in front of it for as long as the leaf is.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

SHORTEST, LONGEST = 0.5, 1.3
"""Metres of a leaf."""

ALIKE = 0.3
"""Metres by which a leaf and its doorway may differ, at most: posts hide the ends of both."""

STRAIGHT = 0.08
"""Metres by which the middle line of a leaf may be off its chord."""

HINGE = 0.3
"""Metres of wall beside a hinge that may be free of the doorway, at most."""

POST = 0.1
"""Metres of wall behind a hinge, at least."""

THICKEST = 0.2
"""Metres of a leaf, at most, as cells show it."""

WALL, WIDEST = 0.3, 2.5
"""Metres along a wall in line with a leaf that make the leaf a wall, and of the door between."""

_EIGHT = np.ones((3, 3), np.bool_)
_AROUND = np.array([(-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1)])
_ANGLES = np.radians([a for side in (90, -90) for a in range(side - 50, side + 51, 5)])

Cells = NDArray[np.bool_]
Floats = NDArray[np.float64]


def door_leaves(solid: Cells, resolution: float) -> Cells:
    """Return the cells (rows, columns) of open leaves of doors among those that are solid."""
    found = np.zeros_like(solid)
    middle = middle_lines(solid)
    for tip, foot in _loose_ends(middle, resolution):
        length = float(np.hypot(*(foot - tip))) * resolution
        if (
            SHORTEST <= length <= LONGEST
            and _is_thin(solid, tip, foot, resolution)
            and _doorway_at(solid, tip, foot, length, resolution)
            and not _goes_on(solid, tip, tip - foot, resolution)
        ):
            found |= _strip(solid, tip, foot, resolution)
    return found


def middle_lines(cells: Cells) -> Cells:
    """Thin cells to lines of one cell: Zhang and Suen, Comm. ACM 27(3), 1984."""
    lines = np.pad(cells, 1)
    while True:
        before = lines.sum()
        for sides in (((0, 2, 4), (2, 4, 6)), ((0, 2, 6), (0, 4, 6))):
            around, number, turns = _around(lines)
            loose = lines & (number >= 2) & (number <= 6) & (turns == 1)
            for three in sides:
                loose &= ~np.logical_and.reduce([around[k] for k in three])
            lines &= ~loose
        if lines.sum() == before:
            return np.asarray(lines[1:-1, 1:-1])


def _around(lines: Cells) -> tuple[list[Cells], NDArray[np.int64], NDArray[np.int64]]:
    """The eight neighbours of each cell, how many are set, and how often they begin to be."""
    around = [np.roll(lines, tuple(-each), axis=(0, 1)) for each in _AROUND]
    begin = [~a & b for a, b in zip(around, around[1:] + around[:1], strict=True)]
    return around, np.sum(around, axis=0), np.sum(begin, axis=0)


def _loose_ends(lines: Cells, resolution: float) -> Iterator[tuple[Floats, Floats]]:
    """Yield the end of each line that ends, and of its straight part the other end."""
    edged = np.pad(lines, 1)
    _, number, turns = _around(edged)
    for end in np.argwhere((edged & (turns == 1) & (number <= 2))[1:-1, 1:-1]):
        path = [end]
        seen = {tuple(end.tolist())}
        while len(path) * resolution < LONGEST + HINGE:
            beside = [
                at
                for at in (path[-1] + _AROUND)
                if tuple(at.tolist()) not in seen
                and (at >= 0).all()
                and (at < lines.shape).all()
                and lines[tuple(at)]
            ]
            if not beside:
                break
            direct = min(beside, key=lambda at: float(np.abs(at - path[-1]).sum()))
            seen.update(tuple(at.tolist()) for at in beside)
            path.append(direct)
        points = np.array(path, np.float64)
        last = _straight_part(points, STRAIGHT / resolution)
        yield points[0], points[last]


def _straight_part(points: Floats, slack: float) -> int:
    """The last of the points up to which all are near the line to it from the first."""
    for last in range(len(points) - 1, 1, -1):
        way = points[last] - points[0]
        across = (points[:last] - points[0]) @ np.array([-way[1], way[0]]) / np.hypot(*way)
        if np.abs(across).max() <= slack:
            return last
    return len(points) - 1


def _doorway_at(solid: Cells, tip: Floats, foot: Floats, length: float, resolution: float) -> bool:
    """Whether a doorway as wide as a leaf is long begins at its foot."""
    way = (foot - tip) / np.hypot(*(foot - tip))
    angles = _ANGLES[:, None]
    rays = np.concatenate(
        [
            np.cos(angles) * way[0] - np.sin(angles) * way[1],
            np.sin(angles) * way[0] + np.cos(angles) * way[1],
        ],
        axis=1,
    )
    steps = np.arange(0.0, (length + ALIKE + HINGE + WALL) / resolution, 0.5)
    ahead = _at(solid, foot + steps[:, None, None] * rays).T
    back = _at(solid, foot - steps[:, None, None] * rays).T
    metres = resolution / 2
    for on, behind in zip(ahead, back, strict=True):
        post = int(np.argmin(behind)) * metres
        first = int(np.argmin(on))
        wall = first + int(np.argmax(on[first:]))
        if post < POST or first * metres > HINGE or not on[wall]:
            continue
        if abs((wall - first) * metres - length) <= ALIKE and (
            post >= WALL or on[wall:][: int(WALL / metres)].all()
        ):
            return True
    return False


def _is_thin(solid: Cells, tip: Floats, foot: Floats, resolution: float) -> bool:
    """Whether most of the solid cells between two points are as thin as a leaf."""
    way = (foot - tip) / np.hypot(*(foot - tip))
    along = np.linspace(0.1, 0.7, 9)[:, None, None] * (foot - tip)
    steps = np.arange(0, 0.5 / resolution, 0.5)[:, None]
    sides = (steps * [-way[1], way[0]], steps * [way[1], -way[0]])
    runs = [np.logical_and.accumulate(_at(solid, tip + along + s), axis=1) for s in sides]
    widths = np.sum([run.sum(axis=1) / 2 for run in runs], axis=0)
    return bool(np.median(widths) * resolution < THICKEST)


def _goes_on(solid: Cells, tip: Floats, way: Floats, resolution: float) -> bool:
    """Whether another wall begins behind a doorway in front of a tip, and goes on as its line."""
    way = way / np.hypot(*way)
    across = np.array([-way[1], way[0]])
    steps = np.arange(WALL / resolution, WIDEST / resolution, 0.5)
    for turn in np.radians([-2.0, 0.0, 2.0]):
        ray = np.cos(turn) * way + np.sin(turn) * across
        first = _at(solid, tip + steps[:, None] * ray)
        if first.any():
            at = tip + steps[first.argmax()] * ray
            on = at + np.arange(0, WALL / resolution, 0.5)[:, None] * ray
            beside = at + np.outer([WALL / resolution, -WALL / resolution], across) + 2 * ray
            if _at(solid, on).mean() > 0.8 and not _at(solid, beside).any():
                return True
    return False


def _strip(solid: Cells, tip: Floats, foot: Floats, resolution: float) -> Cells:
    """The solid cells beside a leaf, but for those of the wall at its foot."""
    found = np.zeros_like(solid)
    way = (foot - tip) / np.hypot(*(foot - tip))
    half = THICKEST / 2 / resolution
    along = np.arange(-half - 1, np.hypot(*(foot - tip)) - half, 0.5)
    across = np.arange(-half, half + 0.5, 0.5)
    cells = np.rint(
        tip + along[:, None, None] * way + across[:, None] * np.array([-way[1], way[0]])
    ).astype(np.int64)
    cells = cells.reshape(-1, 2)
    cells = cells[((cells >= 0) & (cells < solid.shape)).all(axis=1)]
    found[tuple(cells.T)] = True
    return found & solid


def _at(cells: Cells, points: Floats) -> Cells:
    """The values of cells at points (..., 2); False where the grid has none."""
    at = np.rint(points).astype(np.int64)
    inside = np.asarray(((at >= 0) & (at < cells.shape)).all(axis=-1))
    at = np.where(inside[..., None], at, 0)
    found: Cells = cells[at[..., 0], at[..., 1]] & inside
    return found
