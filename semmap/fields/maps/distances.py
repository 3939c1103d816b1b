"""How far voxels are from others: exact Euclidean distances, in dense boxes of bounded size."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from semmap.fields.maps.representation_map import VoxelBox
from semmap_vdb import BoolGrid

__all__ = ["Near", "deep", "near"]

_SIDE = 96
_SLACK = 1e-9  # 0.15 / 0.05 is less than 3


class Near(NamedTuple):
    """A dense box of voxels.

    Attributes
    ----------
    low : (3,) its lowest voxel
    distance : (X, Y, Z) voxels between centres, to the nearest active one
    place : (3, X, Y, Z) that voxel, or nothing if it was not asked for
    within : (X, Y, Z) where it is within reach
    """

    low: NDArray[np.int_]
    distance: NDArray[np.float64]
    place: NDArray[np.int_] | None
    within: NDArray[np.bool_]


def near(
    active: BoolGrid, reach: float, *, box: VoxelBox | None = None, places: bool = False
) -> Iterator[Near]:
    """Boxes that hold all voxels within `reach` voxels of the active ones, or those of `box`."""
    from scipy.ndimage import distance_transform_edt

    halo = math.ceil(reach + _SLACK)
    for low, dense, inner in _tiles(active, halo, box, around=halo):
        if not dense.any():
            continue
        place = None
        if places:
            far, place = distance_transform_edt(~dense, return_indices=True)
            place = place[(slice(None), *inner)] + (low - halo)[:, None, None, None]
        else:
            far = distance_transform_edt(~dense)
        far = far[inner]
        yield Near(low, far, place, np.square(far) <= reach**2 * (1 + _SLACK))


def deep(
    active: BoolGrid, reach: float, *, box: VoxelBox | None = None
) -> Iterator[tuple[NDArray[np.int_], NDArray[np.bool_]]]:
    """Boxes, and where in them a voxel is active and all others within `reach`, too."""
    from scipy.ndimage import distance_transform_edt

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
    """The lowest voxel of each box, what is active in it and its halo, and where in that it is."""
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
