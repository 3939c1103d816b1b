"""Paths around the corners of a room, by its visibility graph.

A route server drives straight from node to node, so two doors around a corner need a node at that
corner. The shortest paths in a polygon bend only at its reflex corners (Lozano-Pérez and Wesley,
1979), which are taken from the outline shrunk by a clearance.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from shapely import MultiPolygon, Polygon

__all__ = ["CornerPaths", "corner_paths"]

CLEARANCE = 0.3
"""Metres between a path and a corner, where there is enough room."""

FINE = 0.02
"""Tolerance of outlines, metres."""


class CornerPaths(NamedTuple):
    """Corners, and the paths between points over them.

    Attributes
    ----------
    corners
        (k, 2) points, metres.
    between
        For each pair i < j of points, the corners on the path; none if the points see each other.
        Pairs without a path are missing.
    """

    corners: NDArray[np.float64]
    between: dict[tuple[int, int], list[int]]


def corner_paths(
    outline: Polygon | MultiPolygon, points: NDArray[np.float64], clearance: float = CLEARANCE
) -> CornerPaths:
    """The shortest paths between points of a room.

    Parameters
    ----------
    outline
        Of the room, metres.
    points
        (n, 2), metres. One outside the outline by more than 2 cm has no path.
    clearance
        Metres; halved until the paths fit.
    """
    points = np.asarray(points, np.float64).reshape(-1, 2)
    tolerant = outline.buffer(FINE, join_style="mitre")
    shapely.prepare(tolerant)
    pairs = np.array(list(combinations(range(len(points)), 2)), np.int64).reshape(-1, 2)
    sees = _visible(tolerant, points, points, pairs)
    between: dict[tuple[int, int], list[int]] = {(int(i), int(j)): [] for i, j in pairs[sees]}
    if sees.all():
        return CornerPaths(np.empty((0, 2)), between)
    found = _around(outline, tolerant, points, pairs[~sees], clearance)
    while len(found.between) < np.count_nonzero(~sees) and clearance > FINE:
        clearance /= 2  # a part of the room is too narrow
        found = _around(outline, tolerant, points, pairs[~sees], clearance)
    return CornerPaths(found.corners, between | found.between)


def _around(
    outline: Polygon | MultiPolygon,
    tolerant: shapely.Geometry,
    points: NDArray[np.float64],
    pairs: NDArray[np.int64],
    clearance: float,
) -> CornerPaths:
    """Paths over corners only. Nodes: points as starts, corners, points as goals."""
    corners = _corners(outline, clearance)
    n, k = len(points), len(corners)
    to_corner = np.indices((n, k)).reshape(2, -1).T
    along = np.array(list(combinations(range(k), 2)), np.int64).reshape(-1, 2)
    to_corner = to_corner[_visible(tolerant, points, corners, to_corner)]
    along = along[_visible(tolerant, corners, corners, along)]
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
    return CornerPaths(corners, between)


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


def _corners(outline: Polygon | MultiPolygon, clearance: float) -> NDArray[np.float64]:
    """The reflex corners of the outline, moved inwards."""
    inner = outline.simplify(FINE).buffer(-clearance, join_style="mitre", mitre_limit=2.0)
    found = []
    for polygon in shapely.get_parts(inner):
        oriented = shapely.geometry.polygon.orient(polygon)
        for ring in (oriented.exterior, *oriented.interiors):
            corner = shapely.get_coordinates(ring)[:-1]
            into, out = corner - np.roll(corner, 1, axis=0), np.roll(corner, -1, axis=0) - corner
            turn = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
            found.append(corner[turn < 0])
    return np.vstack(found) if found else np.empty((0, 2))
