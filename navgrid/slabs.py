"""The cells of a grid that a mesh occupies, without sampling (Deeken et al., section 4.2).

A triangle is clipped to a closed interval of heights and projected to the ground; it occupies the
cells whose half-open square meets the projection. The result is that of exact arithmetic on the
given numbers, if none of them but 0 is within 1e-60 of 0. Polygons are flat meshes.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

import mapbox_earcut
import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

import semmap_native
from navgrid.grid import Grid

Outlines: TypeAlias = shapely.Geometry | Sequence[shapely.Geometry]
"""A polygon, or several."""

FARTHEST = 1e30
"""The largest end of an interval, metres."""

_FEW_FACES = 20_000  # per thread: with fewer, a second thread takes longer


def occupancy(
    mesh: tuple[ArrayLike, ArrayLike],
    intervals: Iterable[tuple[float, float]],
    grid: Grid,
    *,
    solid: ArrayLike | None = None,
    fill: bool | ArrayLike | None = None,
    threads: int | None = None,
) -> NDArray[np.bool_]:
    """Return the cells that a mesh occupies in intervals of height, in one pass.

    Parameters
    ----------
    mesh : (vertices, faces)
        (V, 3) float64 in metres, (F, 3) integers.
    intervals : iterable of (low, high), metres
        Closed, in any order; they may overlap. A plane is [h, h]: a face that lies in it is
        occupied as a whole.
    solid : (F,) integers, optional
        The number of the solid to which each face belongs; by default all belong to one.
    fill : bool or (S,) bool, optional
        Occupy the inside of solids, too: of all, or by number of the solid. Only a solid with a
        closed surface has an inside: each edge is in as many faces in one direction as in the
        other, vertices with equal coordinates being one. Others stay hollow. The shell of a room
        encloses air: do not fill it.
    threads : int, optional
        By default one a processor, and 1 for small meshes; the result is the same.

    Returns
    -------
    (len(intervals), rows, columns) bool

    Raises
    ------
    ValueError
        An array has a wrong shape, a number is not finite, a face has an unknown vertex, an
        interval is upside down, or the result has more than 2**34 cells.

    Examples
    --------
    >>> shelf = np.array([[0, 0, 0.965], [1, 0, 0.965], [0, 0.5, 0.965]])
    >>> layers = occupancy((shelf, [[0, 1, 2]]), [(0, 0.9), (0.9, 1)], Grid((0, 0), 0.25, (3, 5)))
    >>> layers.sum(axis=(1, 2)).tolist()
    [0, 9]

    Notes
    -----
    With fill, the winding number of the solid's section at the lower end of the interval decides
    about a cell that the surface does not meet. This suffices: a column that no surface meets
    within the interval is inside as a whole or not at all.
    """
    numbers = None if solid is None else _integers("solid", solid)
    count = 1 if numbers is None or not numbers.size else int(numbers.max()) + 1
    any_filled, filled = _checked_fill(fill, count)
    faces = _integers("faces", mesh[1])
    return semmap_native.occupancy(  # checks shapes and numbers
        np.ascontiguousarray(mesh[0], dtype=np.float64),
        faces if faces.dtype == np.int32 else faces.astype(np.int64, copy=False),
        _checked_intervals(intervals),
        float(grid.origin[0]),
        float(grid.origin[1]),
        float(grid.resolution),
        int(grid.shape[0]),
        int(grid.shape[1]),
        None if numbers is None else numbers.astype(np.int32, copy=False),
        count if filled is None else len(filled),
        any_filled,
        filled,
        _threads(len(faces)) if threads is None else threads,
    )


def _integers(name: str, value: ArrayLike) -> NDArray[Any]:
    found: NDArray[Any] = np.ascontiguousarray(value)
    if found.size and found.dtype.kind not in "iu":
        raise ValueError(f"{name} are {found.dtype}; give integers")
    return found


def _checked_intervals(intervals: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    ends = []
    for i, interval in enumerate(intervals):
        try:
            low, high = (float(end) for end in interval)
        except (TypeError, ValueError):
            raise ValueError(
                f"interval {i} is {interval!r}; give a pair (a, b) of metres"
            ) from None
        if not (abs(low) <= FARTHEST and abs(high) <= FARTHEST):
            raise ValueError(f"interval {i} is [{low}, {high}]; give ends within {FARTHEST:g} m")
        if low > high:
            raise ValueError(
                f"interval {i} is upside down: [{low}, {high}]; give its lower end first"
            )
        ends.append((low, high))
    return ends


def _checked_fill(
    fill: bool | ArrayLike | None, solid_count: int
) -> tuple[bool, NDArray[np.bool_] | None]:
    if fill is None or isinstance(fill, bool | np.bool_):
        return bool(fill), None
    filled = np.asarray(fill)
    if filled.ndim != 1 or filled.dtype != np.bool_:
        raise ValueError(
            f"fill is {filled.dtype} of shape {filled.shape}; give a bool, or one per solid"
        )
    if len(filled) < solid_count:
        raise ValueError(
            f"fill has {len(filled)} values for {solid_count} solids; give one per solid"
        )
    return bool(filled.any()), np.ascontiguousarray(filled)


def _threads(face_count: int) -> int:
    if face_count < _FEW_FACES:
        return 1
    return min(len(os.sched_getaffinity(0)), math.ceil(face_count / _FEW_FACES), 16)


def area_cells(outlines: Outlines, grid: Grid) -> NDArray[np.bool_]:
    """Return the (rows, columns) bool cells whose half-open square meets polygons, metres."""
    cells: NDArray[np.bool_] = occupancy(mesh_of(flat_triangles(outlines)), [(0, 0)], grid)[0]
    return cells


def mesh_of(triangles: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return (F, 3, 3) triangles as the vertices and faces of a mesh."""
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3)


def flat_triangles(outlines: Outlines) -> NDArray[np.float64]:
    """Return the (F, 3, 3) triangles at z = 0 that make up a polygon or several."""
    parts = []
    for polygon in shapely.get_parts(outlines):
        if polygon.geom_type != "Polygon" or polygon.is_empty:
            continue
        rings = [shapely.get_coordinates(r)[:-1] for r in (polygon.exterior, *polygon.interiors)]
        corners = np.concatenate(rings)
        ends = np.cumsum([len(r) for r in rings], dtype=np.uint32)
        numbers = mapbox_earcut.triangulate_float64(corners, ends)
        parts.append(np.pad(corners, ((0, 0), (0, 1)))[numbers].reshape(-1, 3, 3))
    return np.concatenate(parts) if parts else np.empty((0, 3, 3))
