"""What a route graph takes from the map beside the topology: rooms' outlines, elevators' cabins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from shapely import MultiPolygon, Polygon

__all__ = ["Cabin", "Surroundings"]


@dataclass(frozen=True)
class Cabin:
    """An elevator's cabin from above: its middle in the map's frame, its heading, its size.

    x, y, width (along the cabin's x axis) and depth in metres, yaw in radians.
    """

    x: float
    y: float
    yaw: float
    width: float
    depth: float


@dataclass(frozen=True)
class Surroundings:
    """Outlines of rooms in the map's frame, by place, and cabins by elevator."""

    outlines: Mapping[str, Polygon | MultiPolygon] = field(default_factory=dict)
    cabins: Mapping[str, Cabin] = field(default_factory=dict)
