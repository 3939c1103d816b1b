"""Voxels as plain data: what occupies space and has no triangles, such as a point cloud."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.geometry.extent import extent


@dataclass(frozen=True, eq=False)
class Voxels:
    """Some voxels of a regular lattice, whose axes are those of the map's frame.

    Voxel (i, j, k) covers the half-open cube at (i, j, k) * size, in metres. `triangles` (F, 3, 3)
    are the surface that they contain, in the same frame; None of points.
    """

    size: float
    indices: NDArray[np.int64]
    triangles: NDArray[np.float64] | None = None

    @classmethod
    def of_points(cls, points: ArrayLike, size: float) -> Voxels:
        """Return the voxels that contain points (N, 3), metres, as OpenVDB draws them for mirrors.

        Raises ValueError: a coordinate is not finite, or the size is not above 0; LookupError
        without OpenVDB.
        """
        try:
            import semmap_vdb  # slow to load; few commands need it
        except ImportError as error:
            raise LookupError(
                f"point clouds become voxels by OpenVDB, which cannot be loaded ({error}); install "
                "semmap_vdb (scripts/setup)"
            ) from None
        at = np.asarray(points, np.float64).reshape(-1, 3)
        if not (math.isfinite(size) and size > 0):
            raise ValueError(f"voxel size is {size} m; give one above 0")
        if not np.isfinite(at).all():
            raise ValueError("points: some coordinates are not finite; leave these points out")
        drawn = semmap_vdb.Shape.points(np.ascontiguousarray(at)).voxels(size)
        return cls(size, drawn.astype(np.int64))

    def __len__(self) -> int:
        return len(self.indices)

    @cached_property
    def corners(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """The lowest and the highest corner of all voxels, (3,) metres; None without voxels."""
        if not len(self.indices):
            return None
        low, high = extent(self.indices)
        return low * self.size, (high + 1) * self.size

    @property
    def centres(self) -> NDArray[np.float64]:
        """(N, 3): the middles of the voxels, metres."""
        return np.asarray((self.indices + 0.5) * self.size, np.float64)

    def top_faces(self) -> NDArray[np.float64]:
        """Return the upper faces of voxels with none above them, as triangles (F, 3, 3), metres."""
        there = {*map(tuple, self.indices.tolist())}
        tops = [(i, j, k + 1) for i, j, k in there if (i, j, k + 1) not in there]
        corner = np.array(sorted(tops), np.float64).reshape(-1, 1, 3)
        halves = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]])
        faces: NDArray[np.float64] = (corner[:, None] + halves).reshape(-1, 3, 3) * self.size
        return faces
