"""What a costmap is made from: a storey's entities as arrays, in the map's frame, metres."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from navgrid.grid import Grid

__all__ = ["MARGIN", "NO_TRIANGLES", "Bounds", "Place", "Scene", "Thing", "grid_of"]

Bounds: TypeAlias = tuple[float, float, float, float]
"""Lowest x and y, highest x and y."""

MARGIN = 0.25
"""Metres of a grid beyond the rooms and things that it shows."""

NO_TRIANGLES = np.empty((0, 3, 3))


@dataclass(frozen=True, eq=False)
class Thing:
    """An entity that may be in the way.

    Attributes
    ----------
    types : its semantic type and what subsumes it, the nearest first
    triangles : (F, 3, 3) float64; of a room its mesh, none where it is a drawn outline
    outline : of a room or a region: what it covers on the ground
    state : of a connector: open, closed or locked
    valid : of a region: from when until when it holds; None is for ever
    """

    id: int
    name: str
    kind: Literal["room", "object", "region", "connector", "agent"]
    types: tuple[str, ...] = ()
    triangles: NDArray[np.float64] = field(default_factory=lambda: NO_TRIANGLES)
    outline: Polygon | MultiPolygon | None = None
    properties: dict[str, Any] = field(default_factory=dict)
    state: str | None = None
    valid: tuple[datetime | None, datetime | None] = (None, None)

    def holds_at(self, moment: datetime | None) -> bool:
        """Whether it is valid at a moment; where none is asked, always."""
        begin, end = self.valid
        return moment is None or (
            (begin is None or begin <= moment) and (end is None or moment < end)
        )

    @cached_property
    def bounds(self) -> Bounds | None:
        """What it covers at most; None without geometry."""
        if self.outline is not None:
            x0, y0, x1, y1 = self.outline.bounds
            return x0, y0, x1, y1
        if not len(self.triangles):
            return None
        x, y = (self.triangles[..., k] for k in range(2))
        return float(x.min()), float(y.min()), float(x.max()), float(y.max())


@dataclass(frozen=True, eq=False)
class Place:
    """Where a robot may be: a room or the doorway between two; `floor` is the z of its ground."""

    name: str
    outline: Polygon | MultiPolygon
    floor: float


@dataclass(frozen=True, eq=False)
class Scene:
    """A storey, or a part of it; without places all of it is known.

    `band` is from which z up to which z things belong to it, metres.
    """

    storey: str
    elevation: float
    things: tuple[Thing, ...]
    places: tuple[Place, ...] = ()
    band: tuple[float, float] = (-math.inf, math.inf)

    def reaches(self, thing: Thing) -> bool:
        """Whether a thing with triangles belongs to the storey."""
        if not len(thing.triangles):
            return False
        z = thing.triangles[:, :, 2]
        return bool(z.min() < self.band[1] and z.max() >= self.band[0])


def grid_of(
    scene: Scene, resolution: float, bounds: Bounds | None = None, margin: float = MARGIN
) -> Grid:
    """The grid around bounds, else around a scene's places, else around its things."""
    if bounds is not None and not (bounds[0] < bounds[2] and bounds[1] < bounds[3]):
        raise ValueError(f"the box {bounds} is upside down: give its lower corner first")
    boxes = [bounds] if bounds is not None else [p.outline.bounds for p in scene.places]
    boxes = boxes or [t.bounds for t in scene.things if t.bounds is not None]
    if not boxes:
        raise ValueError(f"storey {scene.storey} has neither rooms nor things with geometry")
    low, high = np.min(boxes, axis=0)[:2] - margin, np.max(boxes, axis=0)[2:] + margin
    return Grid.around((float(low[0]), float(low[1])), (float(high[0]), float(high[1])), resolution)
