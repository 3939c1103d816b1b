"""The functions of voxels that queries may call: coordinates and distances in metres."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.voxel_keys import voxels_of_keys
from semmap.language.schema import Function

VOXEL_FUNCTIONS = {
    each.name: each
    for each in (
        *(Function(axis, ("voxel",), "number") for axis in "xyz"),
        Function("distance", ("voxel", "voxel"), "number"),
    )
}
"""The signatures: `:x`, `:y` and `:z` are coordinates of a centre, `:distance` is between two."""


def centres(keys: NDArray[np.int64], voxel_size: float) -> NDArray[Any]:
    """Return the centres of voxels: (N, 3) metres for (N,) keys."""
    points: NDArray[Any] = (voxels_of_keys(keys) + 0.5) * voxel_size
    return points


def evaluate_function(
    name: str, arguments: list[NDArray[np.int64]], voxel_size: float
) -> NDArray[np.float64]:
    """Return the values (N,) of one of VOXEL_FUNCTIONS in metres, for rows of keys (N,)."""
    if name == "distance":
        a, b = (voxels_of_keys(keys).astype(float) for keys in arguments)
        lengths: NDArray[np.float64] = np.linalg.norm(a - b, axis=1) * voxel_size
        return lengths
    coordinates: NDArray[np.float64] = centres(arguments[0], voxel_size)[:, "xyz".index(name)]
    return coordinates
