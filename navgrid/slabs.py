"""Which cells of a grid a mesh occupies, without sampling (Deeken et al., section 4.2).

A cell is occupied where its half-open square meets the projection of what of a triangle lies within
a closed interval of heights. The answer is that of exact arithmetic on the numbers given, of which
none but 0 is within 1e-60 of 0.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import semmap_native
from navgrid.grid import Grid

__all__ = ["closed_solids", "occupancy", "occupancy_solids", "slices"]

LARGEST = 2**34
"""Cells of all layers beyond which an answer is refused."""

FARTHEST = 1e30
"""Metres beyond which coordinates are refused."""

_FEW_FACES = 20_000  # for which a second thread does not pay


def occupancy(
    mesh: tuple[ArrayLike, ArrayLike],
    intervals: Iterable[tuple[float, float]],
    grid: Grid,
    *,
    solid: ArrayLike | None = None,
    fill: bool | ArrayLike | None = None,
    threads: int | None = None,
) -> NDArray[np.bool_]:
    """The cells that a mesh occupies in intervals of height, all in one pass.

    Parameters
    ----------
    mesh : vertices (V, 3) float64 in metres, faces (F, 3) integer
    intervals : closed [a, b], metres, in any order; they may overlap
    grid : where to draw
    solid : (F,) integer, the number of the solid that each face belongs to; by default all are one
    fill
        Whether the inside of solids is occupied, too, where it shows neither in the interval nor in
        its ends: True for all solids, or (S,) bool by number of solid. Only a solid whose surface
        is closed has an inside; the rest stay hollow (`closed_solids` tells which). A room's shell
        encloses air: do not fill it.
    threads : by default as many as there are processors, one for small meshes

    Returns
    -------
    (len(intervals), rows, columns) bool; the same for any number of threads and order of faces

    Raises
    ------
    ValueError
        Arrays of another shape, numbers that are not finite, faces that name no vertex, intervals
        upside down, an answer of more than `LARGEST` cells.

    Examples
    --------
    >>> shelf = np.array([[0, 0, 0.965], [1, 0, 0.965], [0, 0.5, 0.965]])
    >>> layers = occupancy((shelf, [[0, 1, 2]]), [(0, 0.9), (0.9, 1)], Grid((0, 0), 0.25, (3, 5)))
    >>> layers.sum(axis=(1, 2)).tolist()
    [0, 9]

    Notes
    -----
    With fill, a cell that the surface does not meet is decided by the winding number of the solid's
    section at z = a, at the cell. It suffices: a column that no surface meets between a and b is
    inside throughout or nowhere.
    """
    vertices, faces = _checked_mesh(mesh)
    ends = _checked_intervals(intervals)
    _check_size(grid, len(ends))
    numbers, count = _checked_solid(solid, len(faces))
    any_filled, filled = _checked_fill(fill, count)
    return semmap_native.occupancy(
        vertices,
        faces,
        ends,
        *_frame(grid),
        numbers,
        count if filled is None else len(filled),
        any_filled,
        filled,
        _threads(threads, len(faces)),
    )


def occupancy_solids(
    mesh: tuple[ArrayLike, ArrayLike],
    intervals: Iterable[tuple[float, float]],
    grid: Grid,
    *,
    solid: ArrayLike,
    fill: bool | ArrayLike | None = None,
    threads: int | None = None,
) -> NDArray[np.int32]:
    """Which solid occupies a cell, the one of the lowest number where there are several.

    Parameters are those of `occupancy`.

    Returns
    -------
    (len(intervals), rows, columns) int32, -1 where none does
    """
    vertices, faces = _checked_mesh(mesh)
    ends = _checked_intervals(intervals)
    _check_size(grid, 4 * len(ends))
    numbers, count = _checked_solid(solid, len(faces))
    any_filled, filled = _checked_fill(fill, count)
    return semmap_native.occupancy_solids(
        vertices,
        faces,
        ends,
        *_frame(grid),
        numbers,
        count if filled is None else len(filled),
        any_filled,
        filled,
        _threads(threads, len(faces)),
    )


def closed_solids(
    mesh: tuple[ArrayLike, ArrayLike],
    *,
    solid: ArrayLike | None = None,
    threads: int | None = None,
) -> NDArray[np.bool_]:
    """Which solids have a closed surface: each edge is met as often in one direction as the other.

    Vertices of equal coordinates are one, so that faces need not share numbers.

    Returns
    -------
    (S,) bool, where S is one more than the highest number in `solid`

    Examples
    --------
    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    >>> closed_solids((corners, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])).tolist()
    [True]
    >>> closed_solids((corners, [[0, 2, 1], [0, 1, 3], [1, 2, 3]])).tolist()
    [False]
    """
    vertices, faces = _checked_mesh(mesh)
    numbers, count = _checked_solid(solid, len(faces))
    return semmap_native.closed_solids(
        vertices, faces, numbers, count, _threads(threads, len(faces))
    )


def slices(
    mesh: tuple[ArrayLike, ArrayLike],
    heights: Sequence[float],
    grid: Grid,
    *,
    threads: int | None = None,
) -> NDArray[np.bool_]:
    """The cells that the sections of a mesh with level planes meet.

    A plane is the interval [h, h]: a face that lies in it is met as a whole.

    Parameters
    ----------
    mesh : vertices (V, 3) float64 in metres, faces (F, 3) integer
    heights : z of the planes, metres
    grid : where to draw

    Returns
    -------
    (len(heights), rows, columns) bool

    Raises
    ------
    ValueError
        As `occupancy` does.
    """
    planes = [float(h) for h in heights]
    if not np.isfinite(planes).all():
        raise ValueError(f"heights are finite, not {planes}")
    return occupancy(mesh, [(h, h) for h in planes], grid, threads=threads)


def _checked_mesh(
    mesh: tuple[ArrayLike, ArrayLike],
) -> tuple[NDArray[np.float64], NDArray[np.int32] | NDArray[np.int64]]:
    """The arrays as C++ takes them, which checks the numbers on its way through them."""
    vertices = np.ascontiguousarray(mesh[0], dtype=np.float64)
    faces: NDArray[Any] = np.asarray(mesh[1])
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ValueError(f"vertices have the shape (V, 3), not {vertices.shape}")
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise ValueError(f"faces have the shape (F, 3), not {faces.shape}")
    if faces.size and faces.dtype.kind not in "iu":
        raise ValueError(f"faces are integers, not {faces.dtype}")
    if faces.dtype == np.int32:
        return vertices, np.ascontiguousarray(faces)
    return vertices, np.ascontiguousarray(faces, dtype=np.int64)


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


def _check_size(grid: Grid, layers: int) -> None:
    rows, columns = grid.shape
    if rows * columns * layers > LARGEST:
        raise ValueError(
            f"{layers} layers of {rows} x {columns} cells are more than {LARGEST}; "
            "give fewer intervals, a smaller part or a coarser resolution"
        )


def _checked_solid(
    solid: ArrayLike | None, face_count: int
) -> tuple[NDArray[np.int32] | None, int]:
    if solid is None:
        return None, 1
    numbers = np.asarray(solid)
    if numbers.shape != (face_count,):
        raise ValueError(f"solid has the shape ({face_count},), one a face, not {numbers.shape}")
    if numbers.size == 0:
        return np.zeros(0, np.int32), 1
    if numbers.dtype.kind not in "iu":
        raise ValueError(f"solid holds integers, not {numbers.dtype}")
    highest = int(numbers.max())
    if numbers.min() < 0 or highest > 2**31 - 2:
        raise ValueError(f"solid holds 0 to {2**31 - 2}, not {numbers.min()} to {highest}")
    return np.ascontiguousarray(numbers, dtype=np.int32), highest + 1


def _checked_fill(
    fill: bool | ArrayLike | None, solid_count: int
) -> tuple[bool, NDArray[np.bool_] | None]:
    if fill is None or isinstance(fill, bool | np.bool_):
        return bool(fill), None
    filled = np.asarray(fill)
    if filled.ndim != 1 or filled.dtype != np.bool_:
        raise ValueError(
            f"fill is a bool, or one a solid: not {filled.dtype} of shape {filled.shape}"
        )
    if len(filled) < solid_count:
        raise ValueError(f"fill knows {len(filled)} solids, but there are {solid_count}")
    return bool(filled.any()), np.ascontiguousarray(filled)


class _Frame(NamedTuple):
    origin_x: float
    origin_y: float
    resolution: float
    rows: int
    columns: int


def _frame(grid: Grid) -> _Frame:
    x, y = grid.origin
    if not (abs(x) <= FARTHEST and abs(y) <= FARTHEST):
        raise ValueError(f"the grid's origin {grid.origin} is not within {FARTHEST:g} m")
    if not 1 / FARTHEST <= grid.resolution <= FARTHEST:
        raise ValueError(f"a resolution of {grid.resolution} m is not one of a grid")
    return _Frame(float(x), float(y), float(grid.resolution), *map(int, grid.shape))


def _threads(threads: int | None, face_count: int) -> int:
    if threads is None:
        if face_count < _FEW_FACES:
            return 1
        return min(len(os.sched_getaffinity(0)), math.ceil(face_count / _FEW_FACES), 16)
    if threads < 1 or threads > 256:
        raise ValueError(f"threads are 1 to 256, not {threads}")
    return int(threads)
