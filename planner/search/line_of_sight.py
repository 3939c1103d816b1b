"""Which points an eye can see between obstacles: rays through voxels, many at a time.

It chooses among thousands of viewpoints. What the chosen ones see is then computed on the meshes
(`semmap.belief.views`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["LineOfSight"]

Floats = NDArray[np.float64]

SPARED = 0.12
"""Metres before a point within which nothing hides it: the surface that carries it is there."""


class LineOfSight:
    """The space that triangles leave free.

    Parameters
    ----------
    triangles : (F, 3, 3), metres in the map's frame
    size : float
        Edge of the voxels, metres.
    """

    def __init__(self, triangles: Floats, size: float = 0.05) -> None:
        self.size = size
        if not len(triangles):
            self.low, self.occupied = np.zeros(3), np.zeros((1, 1, 1), np.bool_)
            return
        margin = 2 * size  # the voxels at the border are free
        self.low = triangles.min(axis=(0, 1)) - margin
        shape = np.ceil((triangles.max(axis=(0, 1)) + margin - self.low) / size).astype(int)
        self.occupied = np.zeros(shape, np.bool_)
        edges = triangles - np.roll(triangles, 1, axis=1)
        parts = np.ceil(np.linalg.norm(edges, axis=2).max(axis=1) / (0.9 * size)).astype(int)
        for count in np.unique(np.maximum(parts, 1)):
            some = triangles[np.maximum(parts, 1) == count]
            u, v = np.meshgrid(*2 * [np.arange(count + 1) / count], indexing="ij")
            u, v = u[u + v <= 1 + 1e-9], v[u + v <= 1 + 1e-9]
            weights = np.column_stack([1 - u - v, u, v])
            for chunk in np.array_split(some, max(1, len(some) * len(weights) // 1_000_000)):
                self.occupied.ravel()[self._cells((weights @ chunk).reshape(-1, 3))] = True

    def _cells(self, points: Floats) -> NDArray[np.int64]:
        """(...,) the number of the voxel of each point; outside, of a free one at the border."""
        cells = ((points - self.low) / self.size).astype(np.int32)
        x, y, z = (
            np.clip(cells[..., k], 0, self.occupied.shape[k] - 1).astype(np.int64) for k in range(3)
        )
        numbers: NDArray[np.int64] = (x * self.occupied.shape[1] + y) * self.occupied.shape[2] + z
        return numbers

    def is_free(self, points: Floats) -> NDArray[np.bool_]:
        """(...,) whether points (..., 3) are in no obstacle."""
        return ~self.occupied.ravel()[self._cells(points)]

    def sees(self, eye: Floats, points: Floats) -> NDArray[np.bool_]:
        """(N,) whether nothing is between an eye (3,) and points (N, 3)."""
        offset = points - eye
        length = np.linalg.norm(offset, axis=1)
        count = int(np.ceil(length.max(initial=0) / (0.8 * self.size))) + 1
        clear = np.ones(len(points), np.bool_)
        share = np.clip((length - SPARED) / np.maximum(length, 1e-9), 0, 1)
        for step in np.array_split(np.linspace(0, 1, count), max(1, count // 16)):
            left = np.flatnonzero(clear)
            along = step[None, :, None] * (share[left, None] * offset[left])[:, None]
            clear[left] = self.is_free(eye + along).all(axis=1)
        return clear
