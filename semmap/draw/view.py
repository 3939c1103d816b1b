"""The content of pictures as plain data; lengths in metres, all in the map's frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.query.storey_scene import SceneEntity, StoreyScene

Outline: TypeAlias = Polygon | MultiPolygon


@dataclass(frozen=True)
class RoomView:
    """A room from z `low` to `high`, with its type and supertypes; `label` is its function."""

    name: str
    outline: Outline
    low: float
    high: float
    types: tuple[str, ...] = ()
    label: str | None = None


@dataclass(frozen=True, eq=False)
class ObjectView:
    """An object: its mesh, the area that it covers, and its colour, by default that of its type.

    Where the shape is `assumed`, it is the typical box of the type.
    """

    name: str
    types: tuple[str, ...] = ()
    mesh: Mesh | None = None
    footprint: Outline | None = None
    colour: str | None = None
    assumed: bool = False


@dataclass(frozen=True, eq=False)
class DoorView:
    """A connector with a pose on each side, facing it."""

    name: str
    poses: tuple[Pose, Pose]
    width: float | None = None  # of the clear opening
    type: str = "door"  # or opening, elevator_door, stairs, ramp
    state: str = "open"  # or closed, locked


@dataclass(frozen=True)
class RegionView:
    """A region from z `low` to `high`, metres; `blocked` means closed to robots."""

    name: str
    outline: Outline
    types: tuple[str, ...] = ()
    blocked: bool = False
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, eq=False)
class OccupancyView:
    """An occupancy grid."""

    origin: tuple[float, float]  # of the lower left corner
    resolution: float
    cells: NDArray[np.int8]  # row 0 is the lowest y: 100 occupied, 0 free, -1 unknown

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """The left, right, bottom and top edge."""
        rows, columns = self.cells.shape
        x, y = self.origin
        return (x, x + columns * self.resolution, y, y + rows * self.resolution)


@dataclass(frozen=True, eq=False)
class StoreyView:
    """A storey with the content of a picture of it; `elevation` is the z of its floor."""

    name: str
    elevation: float = 0.0
    rooms: list[RoomView] = field(default_factory=list)
    objects: list[ObjectView] = field(default_factory=list)
    doors: list[DoorView] = field(default_factory=list)
    regions: list[RegionView] = field(default_factory=list)
    occupancy: OccupancyView | None = None
    path: list[NDArray[np.float64]] = field(default_factory=list)  # lines (N, 2) or (N, 3)


def storey_view(scene: StoreyScene) -> StoreyView:
    """Return the inventory of a storey, which `read_storeys` fills, as pictures show it."""
    view = StoreyView(scene.storey, scene.elevation)
    for e in scene.inventory:
        outline = e.footprint
        if e.kind in ("object", "agent"):
            view.objects.append(ObjectView(e.name, e.types, _mesh(e), outline, assumed=e.assumed))
        elif e.kind == "connector" and e.sides is not None:
            form = "opening" if "opening" in e.types else e.form or "door"
            state = e.state or "open"
            view.doors.append(DoorView(e.name, e.sides, e.width, form, state))
        elif e.kind == "region" and outline is not None:
            view.regions.append(_region(e, outline))
        elif e.kind == "room" and outline is not None and e.floor is not None:
            high = e.floor if e.ceiling is None else e.ceiling
            view.rooms.append(RoomView(e.name, outline, e.floor, high, e.types, e.label))
    return view


def _region(entity: SceneEntity, outline: Outline) -> RegionView:
    blocked, heights = entity.is_blocked_region, (entity.floor, entity.ceiling)
    return RegionView(entity.name, outline, entity.types, blocked, *heights)


def _mesh(entity: SceneEntity) -> Mesh | None:
    if not len(entity.triangles):
        return None
    return Mesh.of_triangles(entity.triangles)
