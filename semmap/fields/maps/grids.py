"""The grids of the native module by the type of their values."""

from __future__ import annotations

from typing import Literal

import numpy as np

from semmap.fields.maps.lattice import Lattice
from semmap_vdb import BoolGrid, FloatGrid, Int32Grid

Grid = BoolGrid | Int32Grid | FloatGrid
ValueType = Literal["bool", "int32", "float32"]

GRIDS: dict[ValueType, type[BoolGrid] | type[Int32Grid] | type[FloatGrid]] = {
    "bool": BoolGrid,
    "int32": Int32Grid,
    "float32": FloatGrid,
}
DTYPES = {"bool": np.bool_, "int32": np.int32, "float32": np.float32}


def empty_grid(value_type: ValueType, lattice: Lattice) -> Grid:
    """Return a grid without values."""
    grid = GRIDS[value_type](lattice.voxel_size, False)
    grid.place(lattice.rows)
    return grid


def value_type_of(grid: Grid) -> ValueType:
    """Return the type of the values of a grid."""
    return next(name for name, kind in GRIDS.items() if isinstance(grid, kind))


def lattice_of(grid: Grid) -> Lattice:
    """Return the lattice of a grid."""
    return Lattice(grid.voxel_size, tuple(tuple(row) for row in grid.placement))
