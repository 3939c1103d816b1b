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
    """A room from z `low` to `high`; `types` are its type and supertypes, the nearest first.

    `label` is its function, such as kitchen.
    """

    name: str
    outline: Outline
    low: float
    high: float
    types: tuple[str, ...] = ()
    label: str | None = None


@dataclass(frozen=True, eq=False)
class ObjectView:
    """An object: its mesh, the area that it covers, and its colour, by default that of its type."""

    name: str
    types: tuple[str, ...] = ()
    mesh: Mesh | None = None
    footprint: Outline | None = None
    colour: str | None = None


@dataclass(frozen=True, eq=False)
class DoorView:
    """A connector with a pose on each side, facing it."""

    name: str
    poses: tuple[Pose, Pose]
    width: float | None = None  # of the clear opening
    type: str = "door"  # or elevator_door, stairs, ramp
    state: str = "open"  # or closed, locked


@dataclass(frozen=True)
class RegionView:
    """A region; `blocked` means closed to robots."""

    name: str
    outline: Outline
    types: tuple[str, ...] = ()
    blocked: bool = False


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
    for entity in scene.inventory:
        _add(view, entity)
    return view


def _add(view: StoreyView, entity: SceneEntity) -> None:
    outline = entity.footprint
    match entity.kind:
        case "room" if outline is not None and entity.floor is not None:
            high = entity.floor if entity.ceiling is None else entity.ceiling
            view.rooms.append(
                RoomView(entity.name, outline, entity.floor, high, entity.types, entity.label)
            )
        case "object" | "agent":
            view.objects.append(ObjectView(entity.name, entity.types, _mesh(entity), outline))
        case "region" if outline is not None:
            view.regions.append(
                RegionView(entity.name, outline, entity.types, entity.is_blocked_region)
            )
        case "connector" if entity.sides is not None:
            view.doors.append(
                DoorView(
                    entity.name,
                    entity.sides,
                    entity.width,
                    entity.form or "door",
                    entity.state or "open",
                )
            )


def _mesh(entity: SceneEntity) -> Mesh | None:
    if not len(entity.triangles):
        return None
    faces = np.arange(3 * len(entity.triangles), dtype=np.int32).reshape(-1, 3)
    return Mesh(entity.triangles.reshape(-1, 3), faces)
