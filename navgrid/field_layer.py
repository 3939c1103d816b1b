"""Representation maps as layers of a costmap: obstacles such as people, and social costs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navgrid.grid import Grid
from navgrid.inflation import INSCRIBED
from navgrid.terrain import FloorLevel

if TYPE_CHECKING:  # fields need OpenVDB, a costmap without them does not
    from semmap.fields.maps.representation_map import RepresentationMap

__all__ = ["field_cells", "social_costs"]


def field_cells(
    map: RepresentationMap,
    levels: Sequence[FloorLevel],
    intervals: Sequence[tuple[float, float]],
    grid: Grid,
) -> NDArray[np.float32]:
    """Return the largest value of a map above each cell, by interval of heights.

    Parameters
    ----------
    map : RepresentationMap
    levels : sequence of FloorLevel
        The floor of each cell.
    intervals : sequence of (low, high), metres above the floor
    grid : Grid

    Returns
    -------
    (len(intervals), rows, columns) float32
    """
    from semmap.fields.maps.costmap_layer import layer_cells

    found = np.zeros((len(intervals), *grid.shape), np.float32)
    for level in levels:
        for number, (low, high) in enumerate(intervals):
            above = (level.floor + low, level.floor + high)
            values = layer_cells(map, above, grid.origin, grid.resolution, grid.shape)
            found[number][level.cells] = values[level.cells]
    return found


def social_costs(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the costs of values from 0 to 1; none closes a cell, since only obstacles do."""
    return np.clip(values * (INSCRIBED - 1), 0, INSCRIBED - 1).astype(np.uint8)
