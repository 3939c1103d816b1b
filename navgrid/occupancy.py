"""Which cells of a grid a mesh occupies (Deeken et al., section 4.2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

import semmap_native
from navgrid.grid import Grid

__all__ = ["slices"]


def slices(
    mesh: tuple[ArrayLike, ArrayLike], heights: Sequence[float], grid: Grid
) -> NDArray[np.bool_]:
    """The cells that the sections of a mesh with level planes touch.

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
        Arrays of another shape, numbers that are not finite, faces that name no vertex.
    """
    vertices, faces = _checked(mesh)
    planes = [float(h) for h in heights]
    if not np.isfinite(planes).all():
        raise ValueError(f"heights are finite, not {planes}")
    return semmap_native.slices(vertices, faces, planes, *grid.origin, grid.resolution, *grid.shape)


def _checked(mesh: tuple[ArrayLike, ArrayLike]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    vertices = np.ascontiguousarray(mesh[0], dtype=np.float64)
    faces = np.asarray(mesh[1])
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ValueError(f"vertices have the shape (V, 3), not {vertices.shape}")
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise ValueError(f"faces have the shape (F, 3), not {faces.shape}")
    if not np.isfinite(vertices).all():
        raise ValueError("vertices are finite: mend or leave out those that are not")
    if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise ValueError(f"faces name vertices 0 to {len(vertices) - 1}")
    return vertices, np.ascontiguousarray(faces, dtype=np.int32)
