"""The cells of a grid that a mesh occupies, without sampling (Deeken et al., section 4.2).

A triangle is clipped to a closed interval of heights and projected to the ground; it occupies the
cells whose half-open square meets the projection. The result is that of exact arithmetic on the
given numbers, if none of them but 0 is within 1e-60 of 0.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import semmap_native
from navgrid.grid import Grid

LARGEST = 2**34
"""The most cells of a result, over all layers."""

FARTHEST = 1e30
"""The largest coordinate, metres."""

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
        interval is upside down, or the result has more than `LARGEST` cells.

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
    vertices, faces = _checked_mesh(mesh)
    ends = _checked_intervals(intervals)
    _check_size(grid, len(ends))
    numbers, count = _checked_solid(solid, len(faces))
    any_filled, filled = _checked_fill(fill, count)
    solids = count if filled is None else len(filled)
    workers = _threads(threads, len(faces))
    return semmap_native.occupancy(
        vertices, faces, ends, *_frame(grid), numbers, solids, any_filled, filled, workers
    )


def _checked_mesh(
    mesh: tuple[ArrayLike, ArrayLike],
) -> tuple[NDArray[np.float64], NDArray[np.int32] | NDArray[np.int64]]:
    """Contiguous arrays for the native module, which checks their numbers."""
    vertices = np.ascontiguousarray(mesh[0], dtype=np.float64)
    faces: NDArray[Any] = np.asarray(mesh[1])
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ValueError(f"vertices have the shape {vertices.shape}; give (V, 3)")
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise ValueError(f"faces have the shape {faces.shape}; give (F, 3)")
    if faces.size and faces.dtype.kind not in "iu":
        raise ValueError(f"faces are {faces.dtype}; give integers")
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
        raise ValueError(f"solid has the shape {numbers.shape}; give ({face_count},), one per face")
    if numbers.size == 0:
        return np.zeros(0, np.int32), 1
    if numbers.dtype.kind not in "iu":
        raise ValueError(f"solid is {numbers.dtype}; give integers")
    highest = int(numbers.max())
    if numbers.min() < 0 or highest > 2**31 - 2:
        raise ValueError(f"solid is {numbers.min()} to {highest}; give 0 to {2**31 - 2}")
    return np.ascontiguousarray(numbers, dtype=np.int32), highest + 1


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


class _Frame(NamedTuple):
    origin_x: float
    origin_y: float
    resolution: float
    rows: int
    columns: int


def _frame(grid: Grid) -> _Frame:
    x, y = grid.origin
    if not (abs(x) <= FARTHEST and abs(y) <= FARTHEST):
        raise ValueError(f"the grid's origin is {grid.origin}; give one within {FARTHEST:g} m")
    if not 1 / FARTHEST <= grid.resolution <= FARTHEST:
        raise ValueError(
            f"the grid's resolution is {grid.resolution} m; give {1 / FARTHEST:g} to {FARTHEST:g} m"
        )
    return _Frame(float(x), float(y), float(grid.resolution), *map(int, grid.shape))


def _threads(threads: int | None, face_count: int) -> int:
    if threads is None:
        if face_count < _FEW_FACES:
            return 1
        return min(len(os.sched_getaffinity(0)), math.ceil(face_count / _FEW_FACES), 16)
    if threads < 1 or threads > 256:
        raise ValueError(f"threads is {threads}; give 1 to 256")
    return int(threads)
