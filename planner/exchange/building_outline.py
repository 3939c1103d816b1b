"""The outlines of rooms and the cabins of elevators, which route graphs need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from shapely import MultiPolygon, Polygon

__all__ = ["BuildingOutline", "Cabin"]


@dataclass(frozen=True)
class Cabin:
    """The cabin of an elevator from above: middle in the map's frame, heading and size.

    `x`, `y`, `width` (along the x axis of the cabin) and `depth` in metres, `yaw` in radians.
    """

    x: float
    y: float
    yaw: float
    width: float
    depth: float


@dataclass(frozen=True)
class BuildingOutline:
    """Outlines of rooms in the map's frame, by place, and cabins by elevator."""

    outlines: Mapping[str, Polygon | MultiPolygon] = field(default_factory=dict)
    cabins: Mapping[str, Cabin] = field(default_factory=dict)
