"""A mesh of polygons as triangles."""

from __future__ import annotations

from typing import Any

import mapbox_earcut
import numpy as np
from numpy.typing import NDArray

from semmap.geometry.mesh import Mesh
from semmap.ingest.sdf.elements import Unusable

Ints = NDArray[np.int64]


def polygon_mesh(
    points: Any, counts: Any, corners: Any, where: str, *, left_handed: bool = False
) -> Mesh:
    """Return the triangles of polygons, which may be concave.

    Parameters
    ----------
    points : (N, 3) floats
    counts : (F,) ints, the corners of each face; a face of fewer than three is left out
    corners : (sum of counts,) ints, the points of each face in turn
    where : the element, for the error

    Raises
    ------
    Unusable
        The arrays do not fit each other, or there is no face.

    Examples
    --------
    >>> square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    >>> polygon_mesh(square, [4], [0, 1, 2, 3], "square").faces.tolist()
    [[0, 1, 2], [0, 2, 3]]
    """
    p = np.asarray([] if points is None else points, np.float64).reshape(-1, 3)
    n = np.asarray([] if counts is None else counts, np.int64).reshape(-1)
    c = np.asarray([] if corners is None else corners, np.int64).reshape(-1)
    if (n < 0).any() or n.sum() != len(c) or (len(c) and not 0 <= c.min() <= c.max() < len(p)):
        raise Unusable(where, "its faces name points that it does not have", "Export it again.")
    starts = np.cumsum(n) - n
    found = []
    for count in np.unique(n[n >= 3]).tolist():
        faces = c[starts[n == count][:, None] + np.arange(count)]
        convex = np.ones(len(faces), bool) if count == 3 else _are_convex(p[faces])
        fans = faces[convex]
        first = np.broadcast_to(fans[:, :1], fans[:, 2:].shape)
        found.append(np.stack([first, fans[:, 1:-1], fans[:, 2:]], axis=2).reshape(-1, 3))
        found += [face[_ears(p[face])] for face in faces[~convex]]
    triangles = np.concatenate(found) if found else np.empty((0, 3), np.int64)
    if not len(triangles):
        raise Unusable(where, "has no faces", "Export it with its faces.")
    if left_handed:
        triangles = triangles[:, ::-1]
    return Mesh(p, triangles.astype(np.int32))


def _are_convex(polygons: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (F,) whether polygons (F, N, 3) turn to one side at each corner."""
    edges = np.roll(polygons, -1, axis=1) - polygons
    turns = np.cross(np.roll(edges, 1, axis=1), edges)
    return np.asarray((np.einsum("fnk,fk->fn", turns, _normals(polygons)) >= 0).all(axis=1))


def _normals(polygons: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (F, 3) the normals by Newell's method, as long as twice the area."""
    after = np.roll(polygons, -1, axis=1)
    return np.asarray(np.cross(polygons, after).sum(axis=1))


def _ears(polygon: NDArray[np.float64]) -> Ints:
    """Return (T, 3) the corners of the triangles of a concave polygon (N, 3)."""
    kept = np.delete(np.arange(3), np.abs(_normals(polygon[None])[0]).argmax())
    flat = np.ascontiguousarray(polygon[:, kept])
    found = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], np.uint32))
    ears: Ints = found.astype(np.int64).reshape(-1, 3)
    normal = _normals(polygon[None])[0]
    turned = _normals(polygon[ears]) @ normal < 0
    ears[turned] = ears[turned][:, ::-1]
    return ears
