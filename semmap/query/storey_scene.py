"""The contents of a storey as plain data, in the map's frame, metres."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semmap.geometry.extent import extent
from semmap.geometry.pose import IDENTITY, Pose
from semmap.geometry.voxels import Voxels

Bounds: TypeAlias = tuple[float, float, float, float]
"""Lowest x and y, highest x and y, metres."""

EntityKind: TypeAlias = Literal["room", "object", "region", "connector", "agent"]

NO_TRIANGLES = np.empty((0, 3, 3))

FRAME, IN_OPENING = 0.2, 0.9
"""Metres around the line from post to post where a leaf across an opening is, and the part of its
ground that is there."""

BLOCKED_TYPES = frozenset({"blocked_region", "keepout_zone", "staircase"})
"""Regions of these types are closed to robots."""


@dataclass(frozen=True, eq=False)
class SceneEntity:
    """An entity of the map, where it stands.

    Its types are the semantic type and its supertypes, the nearest first. `triangles` (F, 3, 3) are
    in the map's frame; of a shut door without a mesh they are the box of its opening, of an entity
    `assumed` a typical box for its type, of a room in a scene the walls of its outline where none
    enclose it; empty where the map has no mesh. `floor` and `ceiling` are the z of a room's floor
    and ceiling, or of a region's lower and upper end; `sides` the poses before and behind a
    connector, facing it. A leaf across the opening of a door has the door's `state`.
    """

    id: int
    name: str
    kind: EntityKind
    types: tuple[str, ...] = ()
    triangles: NDArray[np.float64] = field(default_factory=lambda: NO_TRIANGLES)
    footprint: Polygon | MultiPolygon | None = None
    properties: dict[str, Any] = field(default_factory=dict)
    state: str | None = None  # open, closed or locked, of a connector, or of the door of a leaf
    valid: tuple[datetime | None, datetime | None] = (None, None)
    pose: Pose = IDENTITY
    label: str | None = None  # of a room, its function, such as kitchen
    storey: str | None = None  # that holds it, directly or through its holders
    floor: float | None = None
    ceiling: float | None = None
    form: str | None = None  # of a connector: door, stairs, ...
    width: float | None = None  # of a connector's clear opening
    sides: tuple[Pose, Pose] | None = None
    carried: bool = False  # by an agent, with which it moves: it is not an obstacle
    voxels: Voxels | None = None  # of an entity without triangles
    assumed: bool = False

    def holds_at(self, moment: datetime | None) -> bool:
        """Return True if the entity is valid at a moment, or if no moment is given."""
        begin, end = self.valid
        return moment is None or (
            (begin is None or begin <= moment) and (end is None or moment < end)
        )

    @property
    def is_blocked_region(self) -> bool:
        """True for a region that is closed to robots, by its type or by ``blocked: true``."""
        return self.kind == "region" and (
            not BLOCKED_TYPES.isdisjoint(self.types) or self.properties.get("blocked") is True
        )

    @property
    def lacks_geometry(self) -> bool:
        """True for an object without triangles and voxels: it leaves no trace in grids."""
        return self.kind == "object" and self._corners is None

    @cached_property
    def _corners(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """The lowest and the highest corner of triangles and voxels, (3,); None without any."""
        voxels = None if self.voxels is None else self.voxels.corners
        if not len(self.triangles):
            return voxels
        low, high = extent(self.triangles)
        if voxels is None:
            return low, high
        return np.minimum(low, voxels[0]), np.maximum(high, voxels[1])

    @cached_property
    def heights(self) -> tuple[float, float] | None:
        """The lowest and the highest z of the geometry; None without geometry."""
        if self._corners is None:
            return None
        low, high = self._corners
        return float(low[2]), float(high[2])

    @cached_property
    def bounds(self) -> Bounds | None:
        """The ground rectangle of triangles and voxels, or of a region's or room's footprint."""
        if self.kind != "region" and self._corners is not None:
            low, high = self._corners
            return float(low[0]), float(low[1]), float(high[0]), float(high[1])
        if self.kind in ("region", "room") and self.footprint is not None:
            x0, y0, x1, y1 = self.footprint.bounds
            return x0, y0, x1, y1
        return None


@dataclass(frozen=True, eq=False)
class FloorArea:
    """A room or the doorway of a connector, where a robot may drive, and the z of its ground."""

    name: str
    outline: Polygon | MultiPolygon
    floor: float


@dataclass(frozen=True, eq=False)
class StoreyScene:
    """What stands on a storey, or on a part of it.

    `entities` are what reaches into the heights `band` of the storey, wherever its holder is; of
    rooms and regions, those of the storey. `inventory` is what belongs to it by its holder, else by
    its height: the content of a floor plan. Only `semmap.query.storey_reader.read_storeys` fills
    it.
    """

    storey: str
    elevation: float  # the z of the floor outside of `floors`
    entities: tuple[SceneEntity, ...]
    floors: tuple[FloorArea, ...] = ()  # rooms and doorways; if none, all is known ground
    band: tuple[float, float] = (-math.inf, math.inf)
    inventory: tuple[SceneEntity, ...] = ()

    def reaches(self, entity: SceneEntity) -> bool:
        """Return True if an entity has geometry within the heights of the storey."""
        if entity.heights is None:
            return False
        low, high = entity.heights
        return low < self.band[1] and high >= self.band[0]
