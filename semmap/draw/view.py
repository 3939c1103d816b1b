"""What the pictures show, as plain dataclasses; lengths in metres, all in the map's frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose

__all__ = ["DoorView", "ObjectView", "Occupancy", "RegionView", "RoomView", "StoreyView"]

Outline: TypeAlias = Polygon | MultiPolygon


@dataclass(frozen=True)
class RoomView:
    """A room: its outline, and its floor and ceiling heights.

    `types` are its semantic type and the supertypes, the nearest first; `label` its function.
    """

    name: str
    outline: Outline
    low: float
    high: float
    types: tuple[str, ...] = ()
    label: str | None = None


@dataclass(frozen=True, eq=False)
class ObjectView:
    """An object: its triangles and what it covers on the ground; a colour, if not its type's."""

    name: str
    types: tuple[str, ...] = ()
    mesh: Mesh | None = None
    footprint: Outline | None = None
    colour: str | None = None


@dataclass(frozen=True, eq=False)
class DoorView:
    """A connector: a pose on each side, facing it; its clear width, its leaf where it has one."""

    name: str
    poses: tuple[Pose, Pose]
    width: float | None = None
    type: str = "door"
    state: str = "open"
    footprint: Outline | None = None
    mesh: Mesh | None = None


@dataclass(frozen=True)
class RegionView:
    """A region with its meaning: home, blocked, ...; `blocked` where no robot may go."""

    name: str
    outline: Outline
    types: tuple[str, ...] = ()
    blocked: bool = False


@dataclass(frozen=True, eq=False)
class Occupancy:
    """(rows, columns) int8, row 0 the lowest y: 100 occupied, 0 free, -1 unknown."""

    origin: tuple[float, float]
    resolution: float
    cells: NDArray[np.int8]

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top edge in metres."""
        rows, columns = self.cells.shape
        x, y = self.origin
        return (x, x + columns * self.resolution, y, y + rows * self.resolution)


@dataclass(frozen=True, eq=False)
class StoreyView:
    """A storey with all that a picture of it shows.

    `path` are the metres that a route leads on this storey, as lines of (N, 2) or (N, 3) points.
    """

    name: str
    elevation: float = 0.0
    rooms: list[RoomView] = field(default_factory=list)
    objects: list[ObjectView] = field(default_factory=list)
    doors: list[DoorView] = field(default_factory=list)
    regions: list[RegionView] = field(default_factory=list)
    occupancy: Occupancy | None = None
    path: list[NDArray[np.float64]] = field(default_factory=list)
