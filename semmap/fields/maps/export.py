"""Fields as files for other tools: OpenVDB, and points with value and colour for a viewer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.fields.checks import as_points
from semmap.fields.maps.grids import Grid, lattice_of
from semmap.whole_file import write_whole

Values = NDArray[np.bool_] | NDArray[np.int32] | NDArray[np.float32]

PLY_TYPES = {"b": ("uchar", "u1"), "i": ("int", "<i4"), "f": ("float", "<f4")}
RAMP = ((68, 1, 84), (33, 145, 140), (253, 231, 37))
"""Red, green and blue of the lowest, the middle and the highest number."""
PLAIN = (150, 150, 150)
"""The colour of NaN and infinity."""


def write_grid(path: str | Path, grid: Grid, name: str) -> None:
    """Write a grid to a `.vdb` file, or the centres of its active voxels to a `.ply` file.

    `name` is that of the grid in the `.vdb` file. Raises ValueError: another ending.
    """
    path = Path(path)
    if path.suffix == ".vdb":
        grid.write(str(path), name)
    elif path.suffix == ".ply":
        voxels, values = grid.read()
        write_points(path, lattice_of(grid).points_at(voxels + 0.5), values)
    else:
        raise ValueError(
            f"{path.name} has an unknown ending: give a file that ends in .vdb or .ply"
        )


def write_points(
    path: str | Path, points: ArrayLike, values: Values, *, name: str = "value"
) -> None:
    """Write points (N, 3), metres, as binary PLY, each with its value (N,) and a colour.

    Equal integers get equal colours, and others mostly different ones; floats get colours on a ramp
    from the lowest to the highest.
    """
    at = as_points(points, "points")
    ply, dtype = PLY_TYPES[values.dtype.kind]
    rows = np.empty(
        len(at),
        [(axis, "<f4") for axis in "xyz"] + [(c, "u1") for c in "rgb"] + [("value", dtype)],
    )
    colours = _colours(values)
    for k in range(3):
        rows["xyz"[k]] = at[:, k]
        rows["rgb"[k]] = colours[:, k]
    rows["value"] = values
    head = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(rows)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        f"property {ply} {name}\nend_header\n"
    )
    write_whole(path, head.encode("ascii") + rows.tobytes())


def _colours(values: Values) -> NDArray[np.uint8]:
    """Return red, green and blue of each value: (N, 3)."""
    if values.dtype.kind != "f":
        mixed = values.astype(np.uint32) * np.uint32(2654435761)
        return np.stack(
            [60 + ((mixed >> np.uint32(8 * k)) & 127) for k in range(3)], axis=1
        ).astype(np.uint8)
    finite = np.isfinite(values)
    colours = np.full((len(values), 3), PLAIN, np.uint8)
    if finite.any():
        numbers = values[finite].astype(float)
        low, high = numbers.min(), numbers.max()
        share = (numbers - low) / (high - low) if high > low else np.zeros(len(numbers))
        for k, stops in enumerate(zip(*RAMP, strict=True)):
            colours[finite, k] = np.interp(share, (0, 0.5, 1), stops).round()
    return colours
