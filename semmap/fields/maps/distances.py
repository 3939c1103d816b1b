"""Exact Euclidean distances between voxels, in dense boxes of bounded size."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from semmap.fields.maps.lattice import VoxelBox
from semmap_vdb import BoolGrid

_SIDE = 96
_SLACK = 1e-9  # 0.15 / 0.05 is less than 3


class DistanceTile(NamedTuple):
    """Distances in a dense box of voxels."""

    low: NDArray[np.int_]  # (3,) the lowest voxel of the box
    # (X, Y, Z) distance in voxels between centres, to the nearest active voxel
    distance: NDArray[np.float64]
    nearest: NDArray[np.int_] | None  # (3, X, Y, Z) that voxel; None unless it was requested
    within: NDArray[np.bool_]  # (X, Y, Z) where the distance is at most the reach


def distance_tiles(
    active: BoolGrid, reach: float, *, box: VoxelBox | None = None, with_nearest: bool = False
) -> Iterator[DistanceTile]:
    """Yield boxes that contain all voxels within `reach` voxels of an active one.

    Only those in `box` where it is given; tiles have nearest voxels if `with_nearest`.
    """
    from scipy.ndimage import distance_transform_edt  # slow to load; few commands need it

    halo = math.ceil(reach + _SLACK)
    for low, dense, inner in _tiles(active, halo, box, around=halo):
        if not dense.any():
            continue
        nearest = None
        if with_nearest:
            far, nearest = distance_transform_edt(~dense, return_indices=True)
            nearest = nearest[(slice(None), *inner)] + (low - halo)[:, None, None, None]
        else:
            far = distance_transform_edt(~dense)
        far = far[inner]
        yield DistanceTile(low, far, nearest, np.square(far) <= reach**2 * (1 + _SLACK))


def core_tiles(
    active: BoolGrid, reach: float, *, box: VoxelBox | None = None
) -> Iterator[tuple[NDArray[np.int_], NDArray[np.bool_]]]:
    """Yield lowest voxels (3,) of boxes, and where in each all voxels within `reach` are active."""
    from scipy.ndimage import distance_transform_edt  # slow to load; few commands need it

    halo = math.ceil(reach + _SLACK)
    for low, dense, inner in _tiles(active, halo, box, around=0):
        if dense.all():
            yield low, dense[inner]
        elif dense[inner].any():
            far = distance_transform_edt(dense)[inner]
            yield low, np.square(far) > reach**2 * (1 + _SLACK)


def _tiles(
    active: BoolGrid, halo: int, box: VoxelBox | None, *, around: int
) -> Iterator[tuple[NDArray[np.int_], NDArray[np.bool_], Any]]:
    """Yield the lowest voxel of each box, the dense voxels of box and halo, and the box in them."""
    ends = active.bounds()
    if ends is None:
        return
    low, high = np.array(ends[0]) - around, np.array(ends[1]) + around
    if box is not None:
        low, high = np.maximum(low, box.low), np.minimum(high, box.high)
    side = max(_SIDE, 2 * halo)
    starts = [range(a, b + 1, side) for a, b in zip(low.tolist(), high.tolist(), strict=True)]
    for corner in product(*starts):
        first = np.array(corner)
        shape = np.minimum(side, high + 1 - first)
        x, y, z = (first - halo).tolist()
        u, v, w = (shape + 2 * halo).tolist()
        dense = active.read_box((x, y, z), (u, v, w))
        yield first, dense, tuple(slice(halo, halo + n) for n in shape)
