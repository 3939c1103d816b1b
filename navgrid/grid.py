"""Grids on the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

from semmap.limits import GRID_CELLS

__all__ = ["Grid"]


@dataclass(frozen=True)
class Grid:
    """A regular grid: cell (r, c) covers the half-open square at origin + (c, r) * resolution.

    Row 0 is the lowest y, as in ``nav_msgs/OccupancyGrid``. Borders are rounded to doubles as they
    are written: 390 * 0.05 is 19.5.

    Attributes
    ----------
    origin : (x, y) of the lower left corner of cell (0, 0), metres
    resolution : metres a cell
    shape : (rows, columns)
    """

    origin: tuple[float, float]
    resolution: float
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        if not (math.isfinite(self.resolution) and self.resolution > 0):
            raise ValueError(f"a grid's resolution is above 0 m, not {self.resolution}")
        if not all(math.isfinite(v) for v in self.origin):
            raise ValueError(f"a grid's origin is finite, not {self.origin}")
        if min(self.shape) < 1 or GRID_CELLS.exceeded_by(self.shape[0] * self.shape[1]):
            raise ValueError(
                f"a grid has 1 to {GRID_CELLS.value} cells, not {self.shape}; take a coarser "
                f"resolution, or set {GRID_CELLS.variable}"
            )

    @classmethod
    def around(cls, low: tuple[float, float], high: tuple[float, float], resolution: float) -> Grid:
        """The grid of whole cells, aligned to multiples of the resolution, that covers a box."""
        if not (math.isfinite(resolution) and resolution > 0):
            raise ValueError(f"a grid's resolution is above 0 m, not {resolution}")
        first = [math.floor(v / resolution) for v in low]
        last = [math.floor(v / resolution) for v in high]
        shape = (last[1] - first[1] + 1, last[0] - first[0] + 1)
        return cls((first[0] * resolution, first[1] * resolution), resolution, shape)
