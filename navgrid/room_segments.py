"""Rooms and doorways in the free space between walls.

A distance-transform segmentation as in Bormann et al., "Room Segmentation: Survey, Implementation,
and Analysis" (ICRA 2016), section III: free space is flooded from where walls are far, and divided
where floods meet. Two parts stay two rooms if each passage between them could be a doorway: narrow
beside both, and in line with a wall. Where meshes show a lintel above a passage, it is one, however
wide: a beam across a room is none, since no wall goes on in its line.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

WIDE, WIDEST = 1.8, 3.7
"""Metres: from the first on, a passage is the less a doorway the wider it is; from the second on
none."""

DEEPEST, SHALLOWEST, STEP = 2.2, 0.2, 0.05
"""Metres from the walls at which floods begin, from the deepest to the shallowest in steps."""

ALONG = 0.4
"""Metres beside a doorway that are searched for the wall in which it is."""

THICKEST, NARROWEST = 0.6, 0.4
"""Metres across a lintel, and along it."""

LEAST = 0.13
"""The confidence from which a passage divides two rooms."""

_TURNS = np.radians(np.arange(-40, 41, 5))
_EIGHT = np.ones((3, 3), np.bool_)

Cells = NDArray[np.bool_]
Labels = NDArray[np.int32]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Passage:
    """Where two segments meet: their numbers, the walls on both sides, (2, 2) rows and columns."""

    segments: tuple[int, int]
    ends: Floats
    width: float  # between the walls, metres; infinite where there are none on both sides
    along: float  # the part beside its ends on which a wall goes on, of both sides: 0 to 2
    confidence: float = 0.0  # that it is a doorway, 0 to 1

    def judged(self, peaks: Floats) -> float:
        """Return the confidence; `peaks` has the metres from walls within each segment."""
        a, b = self.segments
        if self.width > WIDEST:
            return 0.0
        narrow = 1 - self.width / 2 / min(peaks[a], peaks[b])
        in_line = min(1.0, self.along) ** 2 * (1 + 1.5 * max(0.0, self.along - 1))
        return float(np.clip(narrow * in_line - max(0.0, self.width - WIDE) / 10, 0, 1))


@dataclass(frozen=True, eq=False)
class RoomSegments:
    """The segments of free space: `labels` (rows, columns), 0 on walls; and their passages."""

    labels: Labels
    passages: tuple[Passage, ...]


def room_segments(walls: Cells, resolution: float, above: Cells | None = None) -> RoomSegments:
    """Divide the cells without walls into rooms; cells have sides of `resolution` metres.

    `above` (rows, columns): the cells of walls above persons and doors.
    """
    lintels = [] if above is None else _lintels(walls, above, resolution)
    closed = walls.copy()
    for cells, _ in lintels:
        closed[tuple(cells.T)] = True
    full = closed
    if above is not None and above.any():  # then a lower wall divides no room
        full = closed & ndimage.binary_dilation(above, _EIGHT)
    clearance, nearest = ndimage.distance_transform_edt(
        ~closed, sampling=resolution, return_indices=True
    )
    labels = _flooded(clearance)
    peaks = np.zeros(int(labels.max(initial=0)) + 1)
    np.maximum.at(peaks, labels.ravel(), clearance.ravel())
    passages = [
        _passage(pair, cell, closed, nearest, full, resolution)
        for pair, cells in _borders(labels).items()
        for cell in _widest(cells, clearance)
    ]
    number, passages = _merged(passages, peaks)
    labels = number[labels]
    passages += _below_lintels(lintels, labels, resolution)
    return RoomSegments(labels, tuple(_once(passages, resolution)))


def _once(passages: list[Passage], resolution: float) -> list[Passage]:
    """Leave out a passage at the place of a surer one: noise can part the border in a doorway."""
    kept: list[Passage] = []
    for passage in sorted(passages, key=lambda each: -each.confidence):
        middle = passage.ends.mean(axis=0)
        beside = (each for each in kept if each.segments == passage.segments)
        if all(
            np.hypot(*(each.ends.mean(axis=0) - middle)) * resolution > ALONG for each in beside
        ):
            kept.append(passage)
    return kept


def _lintels(
    walls: Cells, above: Cells, resolution: float
) -> list[tuple[NDArray[np.int64], Floats]]:
    """Return the cells (N, 2) of each lintel and its ends (2, 2): it goes on from wall to wall."""
    parts, count = ndimage.label(above & ~walls, _EIGHT)
    found = []
    for part in range(1, count + 1):
        cells = np.argwhere(parts == part)
        middle = cells.mean(axis=0)
        way = np.linalg.svd(cells - middle, full_matrices=False)[2][0]
        along, across = (cells - middle) @ way, (cells - middle) @ [-way[1], way[0]]
        if np.ptp(across) * resolution > THICKEST or np.ptp(along) * resolution < NARROWEST:
            continue
        ends = middle + np.outer([along.min() - 1, along.max() + 1], way)
        goes_on = [_wall_along(walls, ends[0], -way, resolution)]
        goes_on += [_wall_along(walls, ends[1], way, resolution)]
        if max(goes_on) > 0.8 and min(goes_on) > 0:
            found.append((cells, ends))
    return found


def _below_lintels(
    lintels: list[tuple[NDArray[np.int64], Floats]], labels: Labels, resolution: float
) -> list[Passage]:
    """Return the passages below lintels, each with the two segments that are most beside it."""
    found = []
    for cells, ends in lintels:
        low, high = np.maximum(cells.min(axis=0) - 2, 0), cells.max(axis=0) + 3
        near = labels[low[0] : high[0], low[1] : high[1]]
        mask = np.zeros(near.shape, np.bool_)
        mask[tuple((cells - low).T)] = True
        beside = near[ndimage.binary_dilation(mask, _EIGHT, iterations=2)]
        most = np.argsort(-np.bincount(beside[beside > 0]), kind="stable")[:2]
        if len(most) == 2 and most.min() > 0 and (beside == most[1]).any():
            pair = (int(most.min()), int(most.max()))
            width = float(np.hypot(*(ends[1] - ends[0])) - 1) * resolution
            found.append(Passage(pair, ends, width, 2.0, 1.0))
    return found


def _flooded(clearance: Floats) -> Labels:
    """Number the floods that begin at peaks of the distance from walls, and spread downwards."""
    labels = np.pad(np.zeros(clearance.shape, np.int32), 1)
    inner = labels[1:-1, 1:-1]
    flat, width = labels.reshape(-1), labels.shape[1]
    beside = np.array([-1, 1, -width, width])
    depths = np.arange(DEEPEST, SHALLOWEST - 1e-9, -STEP)
    for depth in (*depths, 0.0):
        mask = clearance > depth
        if depth:
            parts, count = ndimage.label(mask)
            new = np.ones(count + 1, np.bool_)
            new[np.unique(parts[inner > 0])] = False
            new[0] = False
            numbers = np.zeros(count + 1, np.int32)
            numbers[new] = inner.max() + np.arange(1, new.sum() + 1)
            inner[...] = np.where(new[parts], numbers[parts], inner)
        rows, columns = np.nonzero(mask & (inner == 0))
        left = (rows + 1) * width + columns + 1
        while len(left):
            spread = flat[left[:, None] + beside].max(axis=1)
            if not spread.any():
                break
            flat[left] = spread
            left = left[spread == 0]
    return inner.copy()


def _borders(labels: Labels) -> dict[tuple[int, int], NDArray[np.int64]]:
    """Return by pair of segments the cells (N, 2) at which they meet."""
    rows, columns = labels.shape
    found: defaultdict[tuple[int, int], list[NDArray[np.int64]]] = defaultdict(list)
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        first = (max(0, -right), columns - max(0, right))
        a = labels[: rows - down, first[0] : first[1]]
        b = labels[down:, first[0] + right : first[1] + right]
        at = np.argwhere((a != b) & (a > 0) & (b > 0))
        pairs = np.sort(np.stack([a[tuple(at.T)], b[tuple(at.T)]], axis=1), axis=1)
        at[:, 1] += first[0]
        unique, which = np.unique(pairs, axis=0, return_inverse=True)
        for i, pair in enumerate(unique.tolist()):
            met = at[which.ravel() == i]
            found[pair[0], pair[1]] += [met, np.add(met, (down, right))]
    return {pair: np.unique(np.concatenate(cells), axis=0) for pair, cells in found.items()}


def _widest(cells: NDArray[np.int64], clearance: Floats) -> list[tuple[int, int]]:
    """Return of each connected part of a border the cell that is farthest from walls."""
    low = cells.min(axis=0) - 1
    mask = np.zeros(cells.max(axis=0) - low + 2, np.bool_)
    mask[tuple((cells - low).T)] = True
    parts, count = ndimage.label(mask, _EIGHT)
    part_of = parts[tuple((cells - low).T)]
    found = []
    for part in range(1, count + 1):
        own = cells[part_of == part]
        row, column = own[clearance[tuple(own.T)].argmax()].tolist()
        found.append((row, column))
    return found


def _passage(
    pair: tuple[int, int],
    cell: tuple[int, int],
    walls: Cells,
    nearest: NDArray[np.int32],
    full: Cells,
    resolution: float,
) -> Passage:
    """Return the passage through the cell of a border that is farthest from walls."""
    middle = np.array(cell, np.float64)
    one = nearest[:, cell[0], cell[1]].astype(np.float64)
    away = (middle - one) / np.hypot(*(middle - one))
    turned = np.stack(
        [
            np.cos(_TURNS) * away[0] - np.sin(_TURNS) * away[1],
            np.sin(_TURNS) * away[0] + np.cos(_TURNS) * away[1],
        ],
        axis=1,
    )
    steps = np.arange(0.5, WIDEST / resolution, 0.5)
    rays = np.rint(middle + steps[:, None, None] * turned).astype(np.int64)
    hit = _at(walls, rays)
    if not hit.any():
        return Passage(pair, np.stack([one, middle]), math.inf, 0.0)
    step = int(hit.any(axis=1).argmax())
    other = rays[step, int(hit[step].argmax())].astype(np.float64)
    line = (other - one) / np.hypot(*(other - one))
    width = (float(np.hypot(*(other - one))) - 1) * resolution
    along = _wall_along(full, one, -line, resolution) + _wall_along(full, other, line, resolution)
    return Passage(pair, np.stack([one, other]), width, along)


def _wall_along(walls: Cells, end: Floats, way: Floats, resolution: float) -> float:
    """Return on which part of `ALONG` metres from a point a wall goes on, two cells about."""
    steps = np.arange(1, ALONG / resolution + 0.5)
    beside = np.arange(-2, 3)[:, None] * np.array([-way[1], way[0]])
    cells = np.rint(end + steps[:, None, None] * way + beside).astype(np.int64)
    return float(_at(walls, cells).any(axis=1).mean())


def _at(walls: Cells, cells: NDArray[np.int64]) -> Cells:
    """Return the values of cells (..., 2); False where the grid has none."""
    inside = np.asarray(((cells >= 0) & (cells < walls.shape)).all(axis=-1))
    at = np.where(inside[..., None], cells, 0)
    found: Cells = walls[at[..., 0], at[..., 1]] & inside
    return found


def _merged(passages: list[Passage], peaks: Floats) -> tuple[Labels, list[Passage]]:
    """Join the segments whose least sure passage is no doorway, the least sure pair first.

    Returns the new number of each segment, and the passages that are left.
    """
    number = np.arange(len(peaks), dtype=np.int32)
    peaks = peaks.copy()
    while True:
        sure: dict[tuple[int, int], float] = {}
        for passage in passages:
            pair = passage.segments
            sure[pair] = min(sure.get(pair, 1.0), passage.judged(peaks))
        pair = min(sure, key=lambda each: sure[each], default=(0, 0))
        if not sure or sure[pair] >= LEAST:
            return number, [replace(p, confidence=p.judged(peaks)) for p in passages]
        a, b = pair
        number[number == b] = a
        peaks[a] = max(peaks[a], peaks[b])
        joined = []
        for passage in passages:
            c, d = sorted(a if s == b else s for s in passage.segments)
            if c != d:
                joined.append(replace(passage, segments=(c, d)))
        passages = joined
