"""Paths around the corners of a room that keep a distance from its walls, by visibility graphs.

A route server drives straight from node to node, so two doors around a corner need a node at that
corner. The shortest paths of a robot in a polygon are those of a point in the polygon shrunk by the
robot's radius, and bend only at its reflex corners (Lozano-Pérez and Wesley, 1979).

Why: docs/decisions/edges_of_exported_route_graphs_go_around_corners.md
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

CLEARANCE = 0.3
"""Metres between a path and the walls for a robot without shape, where there is enough room."""

FINE = 0.02  # tolerance of outlines, metres, and the smallest clearance
EXACT = 1e-6  # tolerance of computed corners, metres


class CornerPaths(NamedTuple):
    """Corners (k, 2), metres, and for each pair i < j of points the corners on the path.

    A straight path has none; pairs without a path are missing.
    """

    corners: NDArray[np.float64]
    between: dict[tuple[int, int], list[int]]


def corner_paths(
    outline: Polygon | MultiPolygon,
    points: NDArray[np.float64],
    clearances: Sequence[float] = (CLEARANCE,),
    pairs: Iterable[tuple[int, int]] | None = None,
) -> CornerPaths:
    """The shortest paths between points (n, 2) of a room that keep a distance from its walls.

    A point that is nearer to a wall than the clearance, metres, is left by the shortest way. Each
    of the `pairs` i < j, by default all, has the first of the clearances, the largest first, at
    which a path exists; after the last, its half, and so on.
    """
    points = np.asarray(points, np.float64).reshape(-1, 2)
    wanted = combinations(range(len(points)), 2) if pairs is None else pairs
    missing = np.array(list(wanted), np.int64).reshape(-1, 2)
    corners: list[NDArray[np.float64]] = [np.empty((0, 2))]
    between: dict[tuple[int, int], list[int]] = {}
    for clearance in _halved(clearances):
        if not len(missing):
            break
        found = _paths_in(outline, points, missing, clearance)
        first = sum(map(len, corners))
        between |= {pair: [first + k for k in way] for pair, way in found.between.items()}
        corners.append(found.corners)
        missing = np.array([p for p in missing.tolist() if tuple(p) not in between]).reshape(-1, 2)
    return _without_unused(np.concatenate(corners), between)


def _halved(clearances: Sequence[float]) -> list[float]:
    """The clearances, and the last one halved until it is `FINE`."""
    found = [*clearances]
    while found[-1] > FINE:
        found.append(max(found[-1] / 2, FINE))
    return [*found, 0.0]


def _without_unused(
    corners: NDArray[np.float64], between: dict[tuple[int, int], list[int]]
) -> CornerPaths:
    used = sorted({corner for way in between.values() for corner in way})
    places, numbers = np.unique(corners[used].round(4), axis=0, return_inverse=True)
    number = dict(zip(used, numbers.ravel().tolist(), strict=True))
    return CornerPaths(places, {pair: [number[c] for c in way] for pair, way in between.items()})


def _paths_in(
    outline: Polygon | MultiPolygon,
    points: NDArray[np.float64],
    pairs: NDArray[np.int64],
    clearance: float,
) -> CornerPaths:
    """Paths with a clearance. Nodes: points as starts, corners, points as goals."""
    inner = outline.simplify(FINE / 4).buffer(-clearance, join_style="mitre", mitre_limit=2.0)
    if inner.is_empty:
        return CornerPaths(np.empty((0, 2)), {})
    free = inner.buffer(EXACT if clearance else FINE, join_style="mitre")
    shapely.prepare(free)
    # A point outside of `inner` is left, and reached, over the point of `inner` nearest to it.
    lines = shapely.shortest_line(shapely.points(points), inner)
    nearest = shapely.get_coordinates(shapely.get_point(lines, -1))
    stubbed = ~shapely.covers(free, shapely.points(points))
    ends = np.where(stubbed[:, None], nearest, points)
    sees = _visible(free, ends, ends, pairs)
    own = np.flatnonzero(stubbed)
    own_number = dict(zip(own.tolist(), range(len(own)), strict=True))
    turns = _reflex_corners(inner)
    corners = np.concatenate([ends[own], turns])

    def whole(i: int, j: int, turned: list[int]) -> list[int]:
        start, end = ([own_number[n]] if n in own_number else [] for n in (i, j))
        way = [*start, *(len(own) + t for t in turned), *end]
        return [
            k
            for n, k in enumerate(way)
            if n == 0 or math.dist(corners[k], corners[way[n - 1]]) > EXACT
        ]

    between = {(int(i), int(j)): whole(int(i), int(j), []) for i, j in pairs[sees]}
    if not sees.all():
        for (i, j), way in _around(free, turns, ends, pairs[~sees]).items():
            between[i, j] = whole(i, j, way)
    return CornerPaths(corners, between)


def _around(
    free: shapely.Geometry,
    corners: NDArray[np.float64],
    points: NDArray[np.float64],
    pairs: NDArray[np.int64],
) -> dict[tuple[int, int], list[int]]:
    """Paths over corners only. Nodes: points as starts, corners, points as goals."""
    from scipy.sparse import csr_matrix  # slow to load
    from scipy.sparse.csgraph import dijkstra

    n, k = len(points), len(corners)
    to_corner = np.indices((n, k)).reshape(2, -1).T
    along = np.array(list(combinations(range(k), 2)), np.int64).reshape(-1, 2)
    to_corner = to_corner[_visible(free, points, corners, to_corner)]
    along = along[_visible(free, corners, corners, along)]
    off = np.linalg.norm(points[to_corner[:, 0]] - corners[to_corner[:, 1]], axis=1)
    apart = np.linalg.norm(corners[along[:, 0]] - corners[along[:, 1]], axis=1)
    tails = np.concatenate([to_corner[:, 0], n + along[:, 0], n + along[:, 1], n + to_corner[:, 1]])
    heads = np.concatenate(
        [n + to_corner[:, 1], n + along[:, 1], n + along[:, 0], n + k + to_corner[:, 0]]
    )
    metres = np.maximum(np.concatenate([off, apart, apart, off]), 1e-9)
    graph = csr_matrix((metres, (tails, heads)), (2 * n + k, 2 * n + k))
    away, before = dijkstra(graph, indices=range(n), return_predecessors=True)
    between: dict[tuple[int, int], list[int]] = {}
    for i, j in pairs:
        if np.isfinite(away[i, n + k + j]):
            way, at = [], int(before[i, n + k + j])
            while at != i:
                way.append(at - n)
                at = int(before[i, at])
            between[int(i), int(j)] = way[::-1]
    return between


def _visible(
    outline: shapely.Geometry,
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    pairs: NDArray[np.int64],
) -> NDArray[np.bool_]:
    if not len(pairs):
        return np.empty(0, bool)
    lines = shapely.linestrings(np.stack([a[pairs[:, 0]], b[pairs[:, 1]]], axis=1))
    found: NDArray[np.bool_] = shapely.covers(outline, lines)
    return found


def _reflex_corners(inner: Polygon | MultiPolygon) -> NDArray[np.float64]:
    """(k, 2) the corners of an area that point into it."""
    found = []
    for polygon in shapely.get_parts(inner):
        oriented = shapely.geometry.polygon.orient(polygon)
        for ring in (oriented.exterior, *oriented.interiors):
            corner = shapely.get_coordinates(ring)[:-1]
            into, out = corner - np.roll(corner, 1, axis=0), np.roll(corner, -1, axis=0) - corner
            turn = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
            found.append(corner[turn < 0])
    return np.vstack(found) if found else np.empty((0, 2))
