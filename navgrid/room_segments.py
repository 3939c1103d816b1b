"""Rooms and doorways in the free space between walls.

A distance-transform segmentation as in Bormann et al., "Room Segmentation: Survey, Implementation,
and Analysis" (ICRA 2016), section III: free space is flooded from where walls are far, and divided
where floods meet. Two parts stay two rooms if each passage between them could be a doorway: walls
end at both of its sides, or at one and it is narrow, along the direction of most walls; across it,
a doorway is narrower. Gaps in walls along rows and columns, and lintels that meshes show above a
passage, are doorways before the flood; a beam across a room is none, as no wall goes on there.
Passages between the ends of slanted walls are found by a first flood and closed for the second.
Where a wall ends at one side of a passage alone, as in the corner of a room, it leads to a room
from a hall, and else behind a screen or into a niche, which are parts of the room before it.
Pillars divide nothing: what is small and stands free, but for a piece of wall between two doors.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

WIDEST = 3.7
"""Metres: a wider passage is no doorway."""

DOORWAYS = {
    (True, 2, 2): (1.0, 4.2),
    (True, 2, 1): (0.5, 2.75),
    (True, 1, 2): (0.5, 2.75),  # below `SURE`: it is not closed before the second flood
    (True, 1, 1): (0.5, 2.75),
    (False, 2, 2): (0.9, 2.0),
    (False, 1, 2): (0.7, 1.6),
}
"""The confidence of a doorway, and the metres of width at which it is 0.

By whether it is along most walls, at how many of its ends a wall ends, instead of passing by, and
behind how many a wall goes on in line with it: furniture and leaves of doors do not.
"""

IN_LINE = 0.9
"""The part of `ALONG` metres on which a wall goes on that is in line with a doorway."""

LEVEL, STEPS = 0.08, 2
"""Radians between a passage and the direction of walls along which it is; or cells, as turned walls
are rough."""

DEEPEST, SHALLOWEST, STEP = 2.2, 0.2, 0.05
"""Metres from the walls at which floods begin, from the deepest to the shallowest in steps."""

ALONG = 0.4
"""Metres beside a doorway that are searched for the wall in which it is."""

THICKEST, NARROWEST = 0.6, 0.4
"""Metres across a lintel, and along it."""

SHORTEST = 0.2
"""Metres of a wall, at least, that ends beside a doorway."""

ROUGH = 0.15
"""Metres by which the rows of a wall's end may differ: scans, and walls that were turned."""

PILLAR, BESIDE_PILLAR = 0.65, 2.0
"""Metres along rows and columns of a pillar, and of a door beside a piece of wall as small."""

SURE = 0.8
"""The confidence from which a passage is closed before the second flood."""

LEAST = 0.4
"""The confidence from which a passage divides two rooms."""

UNSURE, HALL = 0.5, 3
"""The confidence up to which passages divide rooms from halls alone; the passages of a hall."""

_TURNS = np.radians(sorted(range(-40, 41, 5), key=abs))
_EIGHT = np.ones((3, 3), np.bool_)

Cells = NDArray[np.bool_]
Labels = NDArray[np.int32]
Floats = NDArray[np.float64]


class Gap(NamedTuple):
    """A doorway in a wall: its cells (N, 2), the walls on both sides, (2, 2) rows and columns."""

    cells: NDArray[np.int64]
    ends: Floats
    confidence: float


@dataclass(frozen=True, eq=False)
class Passage:
    """Where two segments meet: their numbers, the walls on both sides, (2, 2) rows and columns."""

    segments: tuple[int, int]
    ends: Floats
    width: float  # between the walls, metres; infinite where there are none on both sides
    confidence: float = 0.0  # that it is a doorway, 0 to 1


@dataclass(frozen=True, eq=False)
class RoomSegments:
    """The segments of free space: `labels` (rows, columns), 0 on walls; and their passages."""

    labels: Labels
    passages: tuple[Passage, ...]


def room_segments(
    walls: Cells,
    resolution: float,
    above: Cells | None = None,
    scanned: bool = False,
    gates: Sequence[Gap] = (),
) -> RoomSegments:
    """Divide the cells without walls into rooms; cells have sides of `resolution` metres.

    `above` (rows, columns): the cells of walls above persons and doors. In what was `scanned`,
    furniture is among the walls: a doorway is in line with walls behind it. `gates` are known ones,
    such as those wider than any doorway.
    """
    pillars, full, gaps = _pillars(walls, above, resolution)
    walls, gaps = walls & ~pillars, [*gaps, *gates]
    _, passages = _flooded_passages(_closed(walls, gaps), full, resolution, scanned)
    gaps += [
        Gap(_doorway(each, walls, resolution), each.ends, each.confidence)
        for each in passages
        if each.confidence >= SURE
    ]
    closed = _closed(walls, gaps)
    labels, passages = _flooded_passages(closed, full, resolution, scanned)
    number, passages = _merged(_once(passages, resolution), int(labels.max(initial=0)) + 1)
    labels = number[labels]
    passages += _in_gaps(gaps, labels, resolution)
    number, passages = _joined_without_hall(_once(passages, resolution), labels)
    labels = number[labels]
    labels = _parted(labels, passages, closed, resolution)
    labels[pillars] = 0
    return RoomSegments(labels, tuple(passages))


def border_labels(labels: Labels) -> Labels:
    """The segments of the cells at the border of the grid, (N,)."""
    return np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])


def _closed(walls: Cells, gaps: Sequence[Gap]) -> Cells:
    """The cells of walls and gaps."""
    closed = walls.copy()
    for gap in gaps:
        closed[tuple(gap.cells.T)] = True
    return closed


def _flooded_passages(
    closed: Cells, full: Cells, resolution: float, scanned: bool
) -> tuple[Labels, list[Passage]]:
    """The segments of the cells that are not closed, and the passages where they meet."""
    clearance, nearest = ndimage.distance_transform_edt(
        ~closed, sampling=resolution, return_indices=True
    )
    labels = _flooded(clearance)
    passages = [
        _passage(pair, cell, closed, nearest, full, resolution, scanned)
        for pair, cells in _borders(labels).items()
        for cell in _widest(cells, clearance)
    ]
    return labels, passages


def wall_heading(cells: Cells) -> float:
    """Return by how many radians, -pi/4 to pi/4, most walls are turned from rows and columns.

    By a Hough transform: the lines of that direction, and across it, have the most border cells.
    """
    points = np.argwhere(cells & ~ndimage.binary_erosion(cells, _EIGHT))[:, ::-1]

    if not len(points):
        return 0.0
    coarse = np.radians(np.arange(-45, 45, 0.5))
    best = coarse[np.argmax([_in_lines(points, angle) for angle in coarse])]
    fine = best + np.radians(np.arange(-0.5, 0.51, 0.05))
    scores = np.array([_in_lines(points, angle) for angle in fine])
    return float(fine[scores > 0.97 * scores.max()].mean())


def _in_lines(points: NDArray[np.int64], angle: float) -> float:
    """How many points are in a line with how many others, along a direction or across it."""
    cos, sin = math.cos(angle), math.sin(angle)
    turned = np.rint(points @ [[cos, -sin], [sin, cos]]).astype(np.int64)
    counts = [np.bincount(each - each.min()) for each in turned.T]
    return float(sum((count**2).sum() for count in counts))


def _parted(labels: Labels, passages: list[Passage], walls: Cells, resolution: float) -> Labels:
    """Let segments end at the doorways between them, where floods meet anywhere beside them."""
    shut = walls.copy()
    for passage in passages:
        shut[tuple(_doorway(passage, walls, resolution).T)] = True
    parts, count = ndimage.label(~shut)
    sizes = np.zeros((count + 1, int(labels.max(initial=0)) + 1), np.int64)
    np.add.at(sizes, (parts.ravel(), labels.ravel()), 1)
    sizes[:, 0] = 0
    most, total = sizes.argmax(axis=1), sizes.sum(axis=1)
    sure = sizes.max(axis=1) > 0.9 * total
    sure[0] = False
    parted = np.where(sure[parts], most[parts], labels).astype(np.int32)
    parted[shut] = 0
    for axis in (0, 1):  # a cell between those that meet elsewhere
        a, b = np.moveaxis(parted, axis, 0)[:-1], np.moveaxis(parted, axis, 0)[1:]
        a[(a != b) & (b > 0)] = 0
    return parted


def _doorway(passage: Passage, walls: Cells, resolution: float) -> NDArray[np.int64]:
    """The cells (N, 2) between the posts of a passage, as deep as both are."""
    one, other = passage.ends
    length = float(np.hypot(*(other - one)))
    way = (other - one) / length
    steps = np.linspace(-1, length + 1, 2 * math.ceil(length) + 5)  # into the walls
    middle = np.rint(one + steps[:, None] * way).astype(np.int64)
    rows = [middle]
    for side in (1, -1):
        for depth in np.arange(0.5, THICKEST / resolution, 0.5):
            row = np.rint(one + steps[:, None] * way + side * depth * np.array([-way[1], way[0]]))
            row = row.astype(np.int64)
            if not _at(walls, row[[0, -1]]).all():
                break
            rows.append(row)
        else:  # past walls, not between their ends
            rows = [middle]
    cells = np.concatenate(rows)
    return cells[((cells >= 0) & (cells < walls.shape)).all(axis=1)]


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


def _pillars(
    walls: Cells, above: Cells | None, resolution: float
) -> tuple[Cells, Cells, list[Gap]]:
    """The cells of pillars; without them, those of walls that may end at doorways, and the gaps.

    A pillar is small, nothing is beside it, and no doors are at two opposite sides of it.
    """
    reach = max(1, round(NARROWEST / 2 / resolution))
    pieces, _ = ndimage.label(ndimage.binary_dilation(walls, _EIGHT, iterations=reach), _EIGHT)
    boxes = ndimage.find_objects(np.where(walls, pieces, 0))
    spans = np.array([0, *(max(s.stop - s.start for s in box) for box in boxes)])
    small = (spans > 0) & (spans * resolution <= PILLAR)
    pillars = np.zeros_like(walls)
    while True:  # a row of pillars that ends at no wall falls from its end
        left = walls & ~pillars
        full, gaps = left, []
        if above is not None and above.any():  # then a lower wall divides no room
            full = left & ndimage.binary_dilation(above, _EIGHT)
            gaps = _lintels(left, above & ~pillars, resolution)
        gaps += wall_gaps(left, full, resolution)
        more = (small & ~_between_doors(pieces, gaps, resolution))[pieces] & left
        if not more.any():
            return pillars, full, gaps
        pillars |= more


def _between_doors(pieces: Labels, gaps: Sequence[Gap], resolution: float) -> Cells:
    """Whether doors are at two opposite sides of each piece of wall, the first of which is none."""
    ways: defaultdict[int, list[Floats]] = defaultdict(list)
    for gap in gaps:
        length = float(np.hypot(*(gap.ends[1] - gap.ends[0])))
        if (length - 1) * resolution <= BESIDE_PILLAR:
            way = (gap.ends[1] - gap.ends[0]) / length
            for end, out in zip(gap.ends, (way, -way), strict=True):
                ways[int(pieces[tuple(np.rint(end).astype(int))])].append(out)
    found = np.zeros(int(pieces.max(initial=0)) + 1, np.bool_)
    for piece, each in ways.items():
        found[piece] = any(one @ other < -0.9 for one in each for other in each)
    return found


def _lintels(walls: Cells, above: Cells, resolution: float) -> list[Gap]:
    """Return the gaps below lintels that go on from wall to wall."""
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
            found.append(Gap(cells, ends, 1.0))
    return found


def wall_gaps(walls: Cells, full: Cells, resolution: float) -> list[Gap]:
    """Return the gaps in walls along rows and columns, at both ends of which a wall ends.

    `full` are the cells of the walls that may end there. A gap is as deep as its wall.
    """
    down = [
        Gap(gap.cells[:, ::-1], gap.ends[:, ::-1], gap.confidence)
        for gap in _gaps_in_rows(walls.T, full.T, resolution)
    ]
    return [*_gaps_in_rows(walls, full, resolution), *down]


def _gaps_in_rows(walls: Cells, full: Cells, resolution: float) -> Iterator[Gap]:
    before, behind = _wall_ends(full, walls, resolution)
    runs = np.zeros_like(walls)
    for row, start, stop in zip(*_runs(~walls), strict=True):
        if start > 0 and stop < walls.shape[1] and before[row, start - 1] and behind[row, stop]:
            runs[row, start:stop] = NARROWEST <= (stop - start) * resolution <= WIDEST
    parts, _ = ndimage.label(runs)
    for part, box in enumerate(ndimage.find_objects(parts), 1):
        cells = np.argwhere(parts[box] == part) + [each.start for each in box]
        rows = np.split(cells[:, 1], np.flatnonzero(np.diff(cells[:, 0])) + 1)
        sides = np.array([row[[0, -1]] for row in rows])
        (top, bottom), (left, right) = cells[[0, -1], 0], np.median(sides, axis=0).astype(int)
        posts = walls[max(top - 2, 0) : bottom + 3, [left - 1, right + 1]]
        beside = ~walls[top - 1 : bottom + 2, left : right + 1]
        if (
            len(posts) == bottom - top + 5
            and not posts[[0, -1]].any()
            and np.ptp(sides, axis=0).max() <= max((bottom - top) // 2, round(ROUGH / resolution))
            and (bottom - top) * resolution <= THICKEST
            and beside[[0, -1]].mean(axis=1).min() >= 0.5
        ):
            row, width = (top + bottom) / 2, (right - left + 1) * resolution
            ends = np.array([[row, left - 1], [row, right + 1]])
            yield Gap(cells, ends, _confidence(True, 2, 2, width))


def _confidence(level: bool, stubs: int, lined: int, width: float) -> float:
    """The confidence of a passage, by the keys of `DOORWAYS`."""
    sure, most = DOORWAYS.get((level, stubs, lined), (0.0, 1.0))
    return sure * float(np.clip((most - width) / 0.6, 0, 1)) if width <= WIDEST else 0.0


def _runs(cells: Cells) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """The rows, first columns and ends of the runs of cells along rows."""
    turns = np.diff(np.pad(cells.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    rows, starts = np.nonzero(turns == 1)
    return rows, starts, np.nonzero(turns == -1)[1]


def _wall_ends(full: Cells, walls: Cells, resolution: float) -> tuple[Cells, Cells]:
    """The cells where a wall along a row may end at the right, and where at the left.

    Free space is above and below them, as near as a wall is thick; the wall goes on behind.
    """
    near, on = (round(length / 2 / resolution) for length in (THICKEST, SHORTEST))
    above, below = (
        ndimage.maximum_filter1d(~walls, 2 * near + 1, axis=0, origin=side)
        for side in (near, -near)
    )
    right, left = (ndimage.minimum_filter1d(full, 2 * on + 1, axis=1, origin=o) for o in (on, -on))
    return full & above & below & right, full & above & below & left


def _in_gaps(gaps: Sequence[Gap], labels: Labels, resolution: float) -> list[Passage]:
    """Return the passages in gaps, each with the two segments that are most beside it."""
    found = []
    for cells, ends, sure in gaps:
        low, high = np.maximum(cells.min(axis=0) - 2, 0), cells.max(axis=0) + 3
        near = labels[low[0] : high[0], low[1] : high[1]]
        mask = np.zeros(near.shape, np.bool_)
        mask[tuple((cells - low).T)] = True
        beside = near[ndimage.binary_dilation(mask, _EIGHT, iterations=2)]
        most = np.argsort(-np.bincount(beside[beside > 0]), kind="stable")[:2]
        if len(most) == 2 and most.min() > 0 and (beside == most[1]).any():
            pair = (int(most.min()), int(most.max()))
            width = float(np.hypot(*(ends[1] - ends[0])) - 1) * resolution
            found.append(Passage(pair, ends, width, sure))
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
    scanned: bool,
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
        return Passage(pair, np.stack([one, middle]), math.inf)
    step = int(hit.any(axis=1).argmax())
    ends = np.stack([one, rays[step, int(hit[step].argmax())]])
    line = ends[1] - ends[0]
    middles = (_wall_end(full, ends[i], way, resolution) for i, way in enumerate((-line, line)))
    stubs = [middle for middle in middles if middle is not None]
    off, along = sorted(np.abs(line))
    level = bool(off <= max(LEVEL * along, STEPS if scanned else 0))
    if len(stubs) == 2 and not level:
        ends = _at_walls(walls, np.stack(stubs))
    way = line / np.hypot(*line)
    lined = sum(
        _wall_along(walls, end, out, resolution) >= IN_LINE
        for end, out in zip(ends, (-way, way), strict=True)
    )
    width = (float(np.hypot(*(ends[1] - ends[0]))) - 1) * resolution
    if not scanned:
        lined = 2 if level or len(stubs) == 2 else 0
    sure = _confidence(level, len(stubs), lined, width)
    return Passage(pair, ends, width, sure)


def _wall_end(walls: Cells, end: Floats, way: Floats, resolution: float) -> Floats | None:
    """Return the middle of a wall's end, across `way` into it.

    None if free space is not before and behind the wall.
    """
    way = way / np.hypot(*way)
    across = np.array([-way[1], way[0]])
    steps = np.arange(0, THICKEST / resolution + 0.5)[:, None]
    cells = np.rint(end + 0.5 * way + np.stack([steps * across, -steps * across])).astype(np.int64)
    free = ~_at(walls, cells)
    if not free.any(axis=1).all() or free[:, 0].any():
        return None
    before, behind = free.argmax(axis=1)
    return np.asarray(end + (before - behind) / 2 * across)


def _at_walls(walls: Cells, ends: Floats) -> Floats:
    """Move the ends of a line (2, 2) along it to the first walls on both sides of its middle."""
    length = float(np.hypot(*(ends[1] - ends[0])))
    steps = np.arange(0, length / 2 + 3, 0.5)[:, None, None]
    on = ends.mean(axis=0) + steps * (ends - ends.mean(axis=0)) / (length / 2)
    hit = _at(walls, np.rint(on).astype(np.int64))
    return ends if hit[0].any() or not hit.any(axis=0).all() else on[hit.argmax(axis=0), [0, 1]]


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


def _joined_without_hall(passages: list[Passage], labels: Labels) -> tuple[Labels, list[Passage]]:
    """Join two segments between which all passages are unsure, if none of the two is a hall.

    What is outside, at the border of the grid, is as a hall.
    """
    doors = Counter(segment for passage in passages for segment in passage.segments)
    doors.update(dict.fromkeys(border_labels(labels).tolist(), HALL))
    surest: defaultdict[tuple[int, int], float] = defaultdict(float)
    for passage in passages:
        surest[passage.segments] = max(surest[passage.segments], passage.confidence)
    pairs = [
        pair
        for pair, confidence in surest.items()
        if confidence <= UNSURE and max(doors[segment] for segment in pair) < HALL
    ]
    return _joined(pairs, passages, int(labels.max(initial=0)) + 1)


def _merged(passages: list[Passage], count: int) -> tuple[Labels, list[Passage]]:
    """Join the segments between which a passage is no doorway.

    Returns the new number of each segment, and the passages that are left.
    """
    sure: defaultdict[tuple[int, int], float] = defaultdict(lambda: 1.0)
    for passage in passages:
        sure[passage.segments] *= passage.confidence
    joined = [pair for pair, each in sure.items() if each < LEAST]
    return _joined(joined, passages, count)


def _joined(
    pairs: Sequence[tuple[int, int]], passages: list[Passage], count: int
) -> tuple[Labels, list[Passage]]:
    """Join pairs of segments; return the new number of each, and the passages that are left."""
    a, b = np.array(pairs, np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    _, number = connected_components(graph, directed=False)
    left = []
    for passage in passages:
        c, d = sorted(int(number[segment]) for segment in passage.segments)
        if c != d:
            left.append(replace(passage, segments=(c, d)))
    return number.astype(np.int32), left
