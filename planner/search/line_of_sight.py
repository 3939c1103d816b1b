"""Which points an eye can see between obstacles: rays through voxels, many at a time.

It chooses among thousands of viewpoints. What the chosen ones see is then computed on the meshes
(`semmap.belief.views`).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from semmap.arrays import Floats

SPARED = 0.12
"""Metres before a point within which nothing hides it: the surface that carries it is there."""


class LineOfSight:
    """The space that triangles (F, 3, 3) leave free, in voxels of a size, metres, map's frame."""

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
                points = (weights @ chunk).reshape(-1, 3)
                self.occupied.ravel()[self._cells(*self._in_voxels(points))] = True

    def _in_voxels(self, points: Floats) -> Floats:
        """(3, N) points (N, 3) in voxels from the grid's corner."""
        return np.ascontiguousarray(((points - self.low) / self.size).T)

    def _cells(self, x: Floats, y: Floats, z: Floats) -> NDArray[np.int64]:
        """(...,) the number of the voxel of each point; outside, of a free one at the border."""
        i, j, k = (
            np.clip(values, 0, length - 1).astype(np.int64)
            for values, length in zip((x, y, z), self.occupied.shape, strict=True)
        )
        numbers: NDArray[np.int64] = (i * self.occupied.shape[1] + j) * self.occupied.shape[2] + k
        return numbers

    def is_free(self, points: Floats) -> NDArray[np.bool_]:
        """(...,) whether points (..., 3) are in no obstacle."""
        cells = self._cells(*self._in_voxels(points.reshape(-1, 3)))
        return (~self.occupied.ravel()[cells]).reshape(points.shape[:-1])

    def free_columns(self, x: Floats, y: Floats, low: float, high: float) -> NDArray[np.bool_]:
        """(X, Y) whether no obstacle is between two heights, at ascending x (X,) and y (Y,)."""
        shape = self.occupied.shape
        bottom, top = ((z - self.low[2]) / self.size for z in (low, high))
        i = np.clip((x - self.low[0]) / self.size, 0, shape[0] - 1).astype(np.int64)
        j = np.clip((y - self.low[1]) / self.size, 0, shape[1] - 1).astype(np.int64)
        columns = self.occupied[i[0] : i[-1] + 1, j[0] : j[-1] + 1]
        layers = columns[:, :, max(0, math.ceil(bottom)) : max(0, math.floor(top))]
        free: NDArray[np.bool_] = ~np.any(layers, axis=2)
        return free[np.ix_(i - i[0], j - j[0])]

    def sees(self, eye: Floats, points: Floats) -> NDArray[np.bool_]:
        """(N,) whether nothing is between an eye (3,) and points (N, 3)."""
        clear = np.ones(len(points), np.bool_)
        if not len(points):
            return clear
        length = np.linalg.norm(points - eye, axis=1)
        count = math.ceil(length.max() / (0.8 * self.size)) + 1
        share = np.clip((length - SPARED) / np.maximum(length, 1e-9), 0, 1)
        start = self._in_voxels(eye[None])
        offset = share * (self._in_voxels(points) - start)
        occupied = self.occupied.ravel()
        for steps in np.array_split(np.linspace(0, 1, count), max(1, count // 16)):
            left = np.flatnonzero(clear)
            along = (s + o[left, None] * steps for s, o in zip(start, offset, strict=True))
            clear[left] = ~occupied[self._cells(*along)].any(axis=1)
        return clear

    def free_shares(self, eye: Floats, points: Floats) -> Floats:
        """(N,) which share of the way from an eye (3,) to points (N, 3) is free of obstacles."""
        steps = np.arange(0, 1, 0.8 * self.size / np.linalg.norm(points - eye, axis=1).max())
        free = self.is_free(eye + steps[:, None] * (points - eye)[:, None])
        shares: Floats = np.logical_and.accumulate(free, axis=1).mean(axis=1)
        return shares


@lru_cache(maxsize=1)
def _space(triangles: bytes) -> LineOfSight:
    return LineOfSight(np.frombuffer(triangles).reshape(-1, 3, 3))


def line_of_sight(triangles: Floats) -> LineOfSight:
    """The space that triangles (F, 3, 3) leave free; the latest one is kept for the next search."""
    return _space(triangles.tobytes())
