"""Where somebody wants to go: a room, a thing, a region."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import shapely

from semmap.geometry.pose import Pose

__all__ = ["Target"]


@dataclass(frozen=True, eq=False)
class Target:
    """An entity as a start or a goal.

    Attributes
    ----------
    place : the room that holds it, or in which it lies; None where the map does not know
    pose : in the map's frame; None where it has no placement
    footprint : what it covers on the ground; None without geometry
    heights : its lowest and highest z, metres
    """

    name: str
    kind: Literal["room", "object", "region", "agent"]
    place: str | None
    pose: Pose | None = None
    footprint: shapely.Geometry | None = None
    heights: tuple[float, float] | None = None
    id: int | None = None
