"""Grids on the ground, and how the frames and files of their storeys are called."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from semmap.geometry.cell_outline import cell_outline
from semmap.limits import GRID_CELLS
from semmap.query.storey_scene import Bounds, StoreyScene

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
"""Cells of `nav_msgs/OccupancyGrid`."""

MARGIN = 0.25
"""Metres of a grid around the rooms and entities that it shows."""


@dataclass(frozen=True)
class Grid:
    """A regular grid: cell (r, c) covers the half-open square at origin + (c, r) * resolution.

    Row 0 is the lowest y, as in ``nav_msgs/OccupancyGrid``. The borders of cells are rounded to
    doubles as people write them: 390 * 0.05 is 19.5.

    Parameters
    ----------
    origin : (x, y)
        The lower left corner of cell (0, 0), metres.
    resolution : float
        The side of a cell, metres.
    shape : (rows, columns)

    Raises
    ------
    ValueError
        A number is not finite, the resolution is not above 0, or there are too many cells or none.

    Examples
    --------
    >>> grid = Grid.around((0.0, 0.0), (2.0, 1.0), 0.5)
    >>> grid.shape, grid.cell(1.2, 0.3)
    ((3, 5), (0, 2))
    """

    origin: tuple[float, float]
    resolution: float
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        _check_resolution(self.resolution)
        if not all(math.isfinite(v) for v in self.origin):
            raise ValueError(f"grid origin {self.origin} is not finite; give x and y in metres")
        if min(self.shape) < 1 or GRID_CELLS.exceeded_by(self.shape[0] * self.shape[1]):
            raise ValueError(
                f"grid shape {self.shape} has no cells or more than {GRID_CELLS.value}; take a "
                f"coarser resolution, or set {GRID_CELLS.variable}"
            )

    @classmethod
    def around(cls, low: tuple[float, float], high: tuple[float, float], resolution: float) -> Grid:
        """Return the grid of whole cells that covers a rectangle, aligned to the resolution.

        `low` and `high` are opposite corners (x, y), metres.
        """
        _check_resolution(resolution)
        first = [math.floor(v / resolution) for v in low]
        last = [math.floor(v / resolution) for v in high]
        shape = (last[1] - first[1] + 1, last[0] - first[0] + 1)
        return cls((first[0] * resolution, first[1] * resolution), resolution, shape)

    @property
    def size_text(self) -> str:
        """Its rows, columns and resolution, for a person."""
        rows, columns = self.shape
        return f"{rows} x {columns} cells of {self.resolution:g} m"

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Return the row and column of the cell at a point; ValueError where the grid has none."""
        column, row = (
            math.floor((v - o) / self.resolution) for v, o in zip((x, y), self.origin, strict=True)
        )
        if not (0 <= row < self.shape[0] and 0 <= column < self.shape[1]):
            raise ValueError(f"({x}, {y}) is not on the grid {self}")
        return row, column

    def area(self, cells: NDArray[np.bool_]) -> shapely.Geometry:
        """Return what cells (rows, columns) cover, metres."""
        return shapely.transform(cell_outline(cells), lambda xy: xy * self.resolution + self.origin)


def scene_grid(
    scene: StoreyScene, resolution: float, bounds: Bounds | None = None, margin: float = MARGIN
) -> Grid:
    """Return the grid around the rooms of a scene; without rooms, around its entities.

    Parameters
    ----------
    bounds : (x0, y0, x1, y1), optional
        Cover this rectangle instead, metres.
    margin : float
        Metres around it.

    Raises
    ------
    ValueError
        The rectangle is upside down, or there is neither a room nor an entity with geometry.
    """
    if bounds is not None and not (bounds[0] < bounds[2] and bounds[1] < bounds[3]):
        raise ValueError(f"box {bounds} is upside down: give its lower corner first")
    rectangles = [bounds] if bounds is not None else [a.outline.bounds for a in scene.floors]
    rectangles = rectangles or [e.bounds for e in scene.entities if e.bounds is not None]
    if not rectangles:
        raise ValueError(
            f"storey {scene.storey} has neither rooms nor objects with geometry; import some"
        )
    return grid_around(rectangles, resolution, margin)


def grid_around(rectangles: Sequence[Bounds], resolution: float, margin: float) -> Grid:
    """Return the grid that covers rectangles (x0, y0, x1, y1) and a margin around them, metres."""
    low, high = np.min(rectangles, axis=0)[:2] - margin, np.max(rectangles, axis=0)[2:] + margin
    return Grid.around((float(low[0]), float(low[1])), (float(high[0]), float(high[1])), resolution)


def as_cells(occupied: NDArray[np.bool_], unknown: NDArray[np.bool_]) -> NDArray[np.int8]:
    """Return the cells of a map: occupied, else unknown, else free. Arrays of one shape."""
    return np.where(occupied, OCCUPIED, np.where(unknown, UNKNOWN, FREE)).astype(np.int8)


ROOT_FRAME = "map"
"""The frame of the map, above those of its storeys."""


def frame_name(storey: str) -> str:
    """Return the name of the frame in which a storey's maps are, a valid name for tf.

    >>> frame_name("floor-1st")
    'map_floor_1st'
    """
    return f"{ROOT_FRAME}_" + (re.sub(r"\W+", "_", storey).strip("_") or "storey")


def file_name(name: str) -> str:
    """Return a storey's or part's name in characters that file names may have.

    >>> file_name("Level 1/B")
    'Level_1_B'
    """
    return re.sub(r"[^\w.-]+", "_", name).strip("._") or "storey"


def check_storey_names(storeys: Iterable[str]) -> None:
    """Raise ValueError if two storeys would have the same folder or the same frame."""
    taken: dict[str, str] = {}
    for storey in storeys:
        for name in (file_name(storey), frame_name(storey)):
            other = taken.setdefault(name, storey)
            if other != storey:
                raise ValueError(
                    f"the storeys {other!r} and {storey!r} would both be written as {name}: "
                    "rename one of them"
                )


def _check_resolution(resolution: float) -> None:
    if not (math.isfinite(resolution) and resolution > 0):
        raise ValueError(f"grid resolution is {resolution} m; give one above 0")
