"""The outlines of rooms, cabins of elevators and drawn lanes, which route graphs need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from shapely import MultiPolygon, Polygon


@dataclass(frozen=True)
class Cabin:
    """The cabin of an elevator from above: middle in the map's frame, metres, and yaw, radians.

    `width` is along its x axis, `depth` across, metres.
    """

    x: float
    y: float
    yaw: float
    width: float
    depth: float


@dataclass(frozen=True, eq=False)
class DrawnLane:
    """A lane of an Open-RMF building from one waypoint to another, by their names in the map.

    `properties` are those of its link: ``bidirectional``, ``orientation``, ``speed_limit``, ...
    """

    start: str
    end: str
    properties: Mapping[str, Any]


@dataclass(frozen=True)
class BuildingOutline:
    """Outlines of rooms in the map's frame, by place, cabins by elevator, and drawn lanes."""

    outlines: Mapping[str, Polygon | MultiPolygon] = field(default_factory=dict)
    cabins: Mapping[str, Cabin] = field(default_factory=dict)
    lanes: tuple[DrawnLane, ...] = ()
