"""What solids leave free of the opening of a door, at the heights at which robots pass."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.pose import Pose
from semmap.query.map_check.building import LINTEL, WALL

LOWEST, APART = 0.1, 0.17
"""Metres above the floor of a door from which solids count, over thresholds and carpets, and
between the heights at which they are looked for, at most."""

LINES = 0.01
"""Metres between the lines straight through an opening along which solids are looked for."""

PASSAGE, FRAME = 0.6, 0.2
"""Metres that a robot of which nothing is known needs, and the part of the width of an opening that
frames, or a stated width that is only nearly true, may take."""

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
T = TypeVar("T")


def taken_lines(door: Pose, width: float, triangles: Floats, top: float = LINTEL) -> Bools:
    """Which lines straight through an opening, from post to post, a solid (F, 3, 3) meets.

    They are as long as walls around an opening may be thick, and no higher than `top`, metres
    above the floor. No part that is thicker than a centimetre is between two heights.
    """
    across = np.asarray((np.arange(round(width / LINES)) + 0.5) * LINES - width / 2, np.float64)
    taken = np.zeros(len(across), np.bool_)
    flat = door.inverse().apply(triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    y = flat[:, :, 1]  # no line meets others, nor does a ray along it
    flat = flat[(y.min(axis=1) <= width / 2) & (y.max(axis=1) >= -width / 2)]
    levels = np.unique(np.concatenate([np.arange(LOWEST, top, APART), corner_heights(flat, top)]))
    for height in (levels + np.append(levels[1:], top)) / 2:
        begin, end = section(flat, height)
        taken |= _are_met(begin, end, across) | _are_inside(begin, end, across)
    return taken


def corner_heights(flat: Floats, top: float) -> Floats:
    """The heights of the corners of faces between `LOWEST` and `top`, to a centimetre."""
    z = flat[:, :, 2].round(2)
    return np.asarray(np.unique(z[(z > LOWEST) & (z < top)]))


def clear_height(door: Pose, width: float, solids: Sequence[Floats]) -> float:
    """How high a robot may be that passes beneath what closes an opening; 0 where none passes."""
    local = [door.inverse().apply(t.reshape(-1, 3)).reshape(-1, 3, 3) for t in solids]
    levels = [LOWEST, *np.unique(np.concatenate([corner_heights(t, LINTEL) for t in local]))]

    def is_closed(level: float) -> bool:
        lines = [taken_lines(door, width, t, level + 0.01) for t in solids]
        return bool(closing(width, dict(enumerate(lines))))

    number = bisect_left(levels, True, key=is_closed)
    return float(levels[min(number, len(levels) - 1)]) if number else 0.0


def closing(width: float, taken: Mapping[T, Bools]) -> list[T]:
    """Which solids close an opening, by the lines that they take: the largest that do together.

    None where what is left is about as wide as the opening, or as a robot.
    """
    least = min(PASSAGE, (1 - FRAME) * width) - LINES
    met = np.zeros(round(width / LINES) + 2, np.bool_)
    met[[0, -1]] = True
    found = []
    for solid, lines in sorted(taken.items(), key=lambda item: -int(item[1].sum())):
        met[1 : len(lines) + 1] |= lines
        found.append(solid)
        if np.diff(np.flatnonzero(met)).max() - 1 < least / LINES:
            return found
    return []


def section(triangles: Floats, height: float) -> tuple[Floats, Floats]:
    """Return the ends, (N, 2) each, of the lines in which faces (F, 3, 3) cross a height."""
    above = triangles[:, :, 2] > height
    crossing = triangles[above.any(axis=1) & ~above.all(axis=1)]
    above = crossing[:, :, 2] > height
    odd = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)  # alone on its side
    tip, *others = (crossing[np.arange(len(odd)), (odd + k) % 3] for k in range(3))
    found = []
    for other in others:
        share = (height - tip[:, 2]) / (other[:, 2] - tip[:, 2])
        found.append((tip + share[:, None] * (other - tip))[:, :2])
    return found[0], found[1]


def _are_met(begin: Floats, end: Floats, across: Floats) -> Bools:
    """Which lines across an opening are met by lines of a section."""
    run = end[:, 0] - begin[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort((np.array([[-WALL], [WALL]]) - begin[:, 0]) / run, axis=0)
    level = np.abs(run) < 1e-9
    first, last = np.where(level, [[0.0], [1.0]], np.clip(ends, 0, 1))
    met = np.where(level, np.abs(begin[:, 0]) < WALL, first < last)
    rise = end[:, 1] - begin[:, 1]
    sides = np.sort([begin[:, 1] + share * rise for share in (first, last)], axis=0)[:, met]
    reach = np.array([[-0.49], [0.49]]) * LINES  # between two lines, one of them is met
    low, high = sides + reach
    return np.asarray(((low <= across[:, None]) & (across[:, None] <= high)).any(axis=1))


def _are_inside(begin: Floats, end: Floats, across: Floats) -> Bools:
    """Which points of an opening are within a section: rays from them meet it an odd time."""
    low, high = np.minimum(begin[:, 1], end[:, 1]), np.maximum(begin[:, 1], end[:, 1])
    first, after = np.searchsorted(across, low), np.searchsorted(across, high)
    counts = after - first  # of the rays that a line crosses
    line = np.repeat(np.arange(len(begin)), counts)
    ray = np.arange(len(line)) - np.repeat(np.cumsum(counts) - counts - first, counts)
    a, b = begin[line], end[line]
    share = (across[ray] - a[:, 1]) / (b[:, 1] - a[:, 1])
    ahead = a[:, 0] + share * (b[:, 0] - a[:, 0]) > 0
    found: Bools = np.bincount(ray[ahead], minlength=len(across)) % 2 == 1
    return found
