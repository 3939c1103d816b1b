"""The ground of a room on which a robot's base stands: all that the search for base poses needs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from navgrid.costmap import Costmap
from navgrid.grid import Grid
from navgrid.headings import footprint_cells
from navgrid.inflation import INSCRIBED
from navgrid.window import Window
from planner.robot_class import RobotClass

WALLS = "room_geometry"  # the costmap layer that has the walls


@dataclass(frozen=True, eq=False)
class RoomGround:
    """The part of a storey's costmap that a room covers, for one class of robots.

    `window` are the rows and columns of the storey's grid that `grid` and `costs` (rows, columns)
    uint8 cover; costs are unknown outside of the room and its doorways. `floor` is the height of
    the floor in the map's frame, metres. A robot that touches one of the lines `doors` blocks a
    doorway.
    """

    place: str
    robot: RobotClass
    costmap: Costmap
    window: Window
    grid: Grid
    costs: NDArray[np.uint8]
    floor: float
    doors: tuple[shapely.LineString, ...] = ()

    def free(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The free cells of the window, (N, 2), and their middles, metres."""
        cells = np.argwhere(self.costs < INSCRIBED)
        return cells, np.array(self.grid.origin) + (cells[:, ::-1] + 0.5) * self.grid.resolution

    def near(
        self, shape: shapely.Geometry, reach: tuple[float, float]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """The free cells from which a shape is within reach: cells, middles, distances to it."""
        cells, points = self.free()
        x0, y0, x1, y1 = shape.bounds
        near, far = reach
        close = ((points >= (x0 - far, y0 - far)) & (points <= (x1 + far, y1 + far))).all(axis=1)
        cells, points = cells[close], points[close]
        away = shapely.distance(shapely.points(points), shape)
        fits = (away >= near) & (away <= far)
        return cells[fits], points[fits], away[fits]

    def touches(self, point: NDArray[np.float64], heading: float) -> bool:
        """Whether the footprint of a part touches a door, or an obstacle at the part's heights."""
        costmap = self.costmap
        if self.doors:
            cos, sin = math.cos(heading), math.sin(heading)
            turn = np.array([[cos, sin], [-sin, cos]])
            parts = [shapely.Polygon(part.footprint @ turn + point) for part in costmap.parts]
            if any(door.intersects(part) for door in self.doors for part in parts):
                return True
        row, column = costmap.grid.cell(float(point[0]), float(point[1]))
        for number, part in enumerate(costmap.parts):
            cells, (r, c) = footprint_cells(part.footprint, heading, costmap.grid.resolution)
            for seen, mask in _overlap(cells, row - r, column - c, costmap.grid.shape):
                if any((layer[number][seen] & mask).any() for layer in costmap.occupied.values()):
                    return True
        return False

    def walls(self) -> NDArray[np.bool_]:
        """(rows, columns) bool: the wall cells of the window at the heights of the highest part."""
        cells = self.costmap.occupied.get(WALLS)
        if cells is None:
            return np.zeros(self.grid.shape, np.bool_)
        parts = self.costmap.parts
        top = max(range(len(parts)), key=lambda k: parts[k].interval[1])
        walls: NDArray[np.bool_] = cells[top][self.window]
        return walls


def _overlap(
    cells: NDArray[np.bool_], row: int, column: int, shape: tuple[int, int]
) -> Iterator[tuple[Window, NDArray[np.bool_]]]:
    """The window of a grid that a mask at a cell covers, and that part of the mask."""
    r0, c0 = max(0, row), max(0, column)
    r1, c1 = min(shape[0], row + cells.shape[0]), min(shape[1], column + cells.shape[1])
    if r0 < r1 and c0 < c1:
        yield (slice(r0, r1), slice(c0, c1)), cells[r0 - row : r1 - row, c0 - column : c1 - column]
