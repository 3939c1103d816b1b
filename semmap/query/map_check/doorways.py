"""The free part of a door's opening between solids, and the robots that pass it."""

from __future__ import annotations

import itertools
from bisect import bisect_left
from collections.abc import Hashable, Iterable, Mapping
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.floor import section
from semmap.geometry.pose import Pose
from semmap.geometry.walk import EXACT
from semmap.query.map_check.building import LINTEL, WALL

GROUND, CLIMB, LOW = 0.02 + EXACT, 0.2, 0.5
"""Metres: over what a robot of which nothing is known drives, and others climb; a low robot."""

PASSAGE, NARROWEST, FRAME = 0.6, 0.2, 0.2
"""Metres that a robot of which nothing is known needs, and the narrowest ones; the part of a
narrower opening that frames, or a stated width that is only nearly true, may take."""

SAME = 1e-6
"""Metres: what is this near touches."""

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Intervals = list[tuple[float, float]]
T = TypeVar("T", bound=Hashable)


class DoorOpening(Generic[T]):
    """The opening of a door, `width` metres from post to post, and solids (F, 3, 3) at it.

    They count as far beside the door as walls around an opening may be thick. Heights are metres
    above its floor, and closed.
    """

    def __init__(self, door: Pose, width: float, solids: Mapping[T, Floats]) -> None:
        self.half = width / 2
        self.least = (PASSAGE if width >= PASSAGE else (1 - FRAME) * width) - SAME
        self.solids: dict[T, Floats] = {}
        for key, faces in solids.items():
            flat = door.inverse().apply(faces.reshape(-1, 3)).reshape(-1, 3, 3)
            y = flat[:, :, 1]  # lines and rays straight through meet no others
            self.solids[key] = flat[(y.min(axis=1) <= self.half) & (y.max(axis=1) >= -self.half)]

    def taken(self, solid: T, low: float = GROUND, top: float = LINTEL) -> Intervals:
        """Which parts of the width a solid takes at these heights, metres from the middle."""
        faces = self.solids[solid]
        ends = np.array([[-WALL, -self.half, low - SAME], [WALL, self.half, top + SAME]])
        spans = _joined(_extents(faces, ends))
        edges = [-self.half, *itertools.chain(*spans), self.half]
        gaps = [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if a < b]
        lines, _ = section(faces, (low + top) / 2)
        inside = _are_inside(lines[:, 0], lines[:, 1], np.array([(a + b) / 2 for a, b in gaps]))
        return _joined([*spans, *itertools.compress(gaps, inside)])

    def gap(self, solids: Iterable[T], low: float = GROUND, top: float = LINTEL) -> float:
        """The width of the widest gap that some of the solids leave at these heights, metres."""
        taken = [span for solid in solids for span in self.taken(solid, low, top)]
        spans = _joined([(-np.inf, -self.half), *taken, (self.half, np.inf)])
        return max((b - a for (_, a), (b, _) in itertools.pairwise(spans)), default=0.0)

    def closing(self, solids: Iterable[T]) -> list[T]:
        """Which solids close it: the largest that do together; none where a robot passes."""
        sizes = {solid: sum(b - a for a, b in self.taken(solid)) for solid in solids}
        ranked = sorted(sizes, key=lambda solid: -sizes[solid])
        counts = range(1, len(ranked) + 1)
        return next((ranked[:n] for n in counts if self.gap(ranked[:n]) < self.least), [])

    def passing(self, solids: list[T]) -> str:
        """Which robot gets past solids that close it, in words."""
        z = np.unique(np.concatenate([self.solids[s][:, :, 2].ravel() for s in solids]))
        sills = z[(z > GROUND - SAME) & (z <= CLIMB)]
        tops = z[(z > GROUND) & (z <= LINTEL + SAME)]
        # the higher robots climb, or the lower they are, the wider is the gap
        n = bisect_left(sills, self.least, key=lambda sill: self.gap(solids, low=sill + 3 * SAME))
        if n < len(sills):
            return f"only a robot that climbs {sills[n]:.3f} m passes"
        n = bisect_left(
            tops, True, key=lambda top: self.gap(solids, top=top - 3 * SAME) < self.least
        )
        if n:
            return f"only a robot lower than {tops[n - 1]:.2f} m passes"
        if (gap := self.gap(solids)) >= NARROWEST:
            return f"only a robot narrower than {gap:.3f} m passes"
        if self.gap(solids, CLIMB, LOW) >= NARROWEST:
            return f"no robot {PASSAGE} m wide and {LINTEL} m high passes"
        return "no robot passes"


def _joined(spans: Iterable[tuple[float, float]]) -> Intervals:
    """Intervals without those that overlap or touch, ascending."""
    found: Intervals = []
    for low, high in sorted(spans):
        if found and low <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], high)
        else:
            found.append((low, high))
    return found


def _extents(faces: Floats, ends: Floats) -> Intervals:
    """The extents in y of what faces (F, 3, 3) have within a box, whose ends (2, 3) are given.

    They are at corners, at edges that cross a side of the box, or where one of its edges along y
    meets the face.
    """
    faces = faces[((faces.max(axis=1) >= ends[0]) & (faces.min(axis=1) <= ends[1])).all(axis=1)]
    sides = [(axis, end) for axis in (0, 2) for end in ends[:, axis]]
    points = [faces]
    with np.errstate(divide="ignore", invalid="ignore"):
        for (axis, end), k in itertools.product(sides, range(3)):
            a, b = faces[:, k], faces[:, (k + 1) % 3]
            share = (end - a[:, axis]) / (b[:, axis] - a[:, axis])
            share[~((share >= 0) & (share <= 1))] = np.nan
            points.append((a + share[:, None] * (b - a))[:, None])
        (a, b, c) = (faces[:, k] for k in range(3))
        ab, ac = b - a, c - a
        area = ab[:, 0] * ac[:, 2] - ab[:, 2] * ac[:, 0]
        for x, z in itertools.product(ends[:, 0], ends[:, 2]):
            u = ((x - a[:, 0]) * ac[:, 2] - (z - a[:, 2]) * ac[:, 0]) / area
            v = ((z - a[:, 2]) * ab[:, 0] - (x - a[:, 0]) * ab[:, 2]) / area
            met = a + u[:, None] * ab + v[:, None] * ac
            met[~((u >= 0) & (v >= 0) & (u + v <= 1))] = np.nan
            points.append(met[:, None])
    every = np.concatenate(points, axis=1)
    within = ((every >= ends[0] - 1e-9) & (every <= ends[1] + 1e-9))[:, :, ::2].all(axis=2)
    low = np.where(within, every[:, :, 1], np.inf).min(axis=1, initial=np.inf)
    high = np.where(within, every[:, :, 1], -np.inf).max(axis=1, initial=-np.inf)
    met = low <= high
    clipped = np.clip([low[met], high[met]], *ends[:, 1])
    return [(float(a), float(b)) for a, b in clipped.T if b > ends[0, 1] and a < ends[1, 1]]


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
