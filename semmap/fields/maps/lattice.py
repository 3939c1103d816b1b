"""Lattices of voxels: the size of a voxel, and the frame of a grid."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

_IDENTITY = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))


class VoxelBox(NamedTuple):
    """The voxels from `low` to `high`, both included."""

    low: tuple[int, int, int]
    high: tuple[int, int, int]

    def grown(self, by: int) -> VoxelBox:
        """Return the box with `by` more voxels on each side."""
        x, y, z = self.low
        u, v, w = self.high
        return VoxelBox((x - by, y - by, z - by), (u + by, v + by, w + by))


@dataclass(frozen=True)
class Lattice:
    """The edge of voxels in metres, and the pose of their frame in the shared frame.

    `placement` has the upper three rows of a (4, 4) rigid transform.
    """

    voxel_size: float
    placement: tuple[tuple[float, ...], ...] = _IDENTITY

    @property
    def rows(self) -> list[list[float]]:
        """The placement as lists, for the native code."""
        return [list(row) for row in self.placement]

    def voxels_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (N, 3) of the shared frame in voxels (N, 3), not rounded."""
        m = np.array(self.placement)
        at: NDArray[np.float64] = (points - m[:, 3]) @ m[:, :3] / self.voxel_size
        return at

    def points_at(self, voxels: ArrayLike) -> NDArray[np.float64]:
        """Return places (N, 3) in voxels, of which centres are at 0.5, as shared points (N, 3)."""
        m = np.array(self.placement)
        own = np.asarray(voxels, float) * self.voxel_size
        points: NDArray[np.float64] = own @ m[:, :3].T + m[:, 3]
        return points

    def box_in(self, box: VoxelBox, other: Lattice) -> VoxelBox:
        """Return a box of another lattice that contains all voxels that meet a box of this one."""
        if other == self:
            return box
        ends = np.array([box.low, np.add(box.high, 1)])
        corners = self.points_at(np.array(list(product(*ends.T))))
        at = np.floor(other.voxels_at(corners))
        return VoxelBox(_triple(at.min(axis=0)), _triple(at.max(axis=0))).grown(1)


def _triple(values: NDArray[np.float64] | NDArray[np.int_]) -> tuple[int, int, int]:
    return cast(tuple[int, int, int], tuple(int(v) for v in values))
