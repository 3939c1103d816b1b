"""Places at which objects can be, and the place that a point in the map belongs to.

Which places have room for an object, the database decides (``places_for``).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from semmap.geometry.pose import IDENTITY, Pose

BELOW, ABOVE = 0.05, 0.5
"""Metres that a detected point may be below a surface, and above it: an object has its height."""

LEVEL = 0.4
"""Metres between the levels at which objects may be in a volume, at most."""

BORDER = 0.03
"""Metres by which a detected point may miss the edge of a surface."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A level area on which objects stand: an outline in the map's frame, metres, at a height z.

    `weight` is how readily things are kept there, per area.
    """

    outline: shapely.Geometry
    height: float
    weight: float = 1.0


@dataclass(frozen=True, eq=False)
class BeliefPlace:
    """An object or room at which other objects can be; metres in the map's frame.

    `surfaces` are where objects stand: of a room, its floor. `low` and `high` (3,) are corners of
    its box; None without geometry. `stores`: objects are in it, too, as in a container, `inside`
    as readily per area of its footprint.
    """

    name: str
    kind: str
    surfaces: tuple[Surface, ...] = ()
    low: NDArray[np.float64] | None = None
    high: NDArray[np.float64] | None = None
    footprint: shapely.Geometry | None = None
    pose: Pose = field(default=IDENTITY)
    storey: str | None = None
    stores: bool = False
    inside: float = 1.0

    @property
    def area(self) -> float:
        """Of its surfaces, else of its footprint, square metres; NaN without geometry."""
        if self.surfaces:
            return float(sum(surface.outline.area for surface in self.surfaces))
        return math.nan if self.footprint is None else float(self.footprint.area)


def place_at(
    places: Iterable[BeliefPlace], point: ArrayLike, height: float = 0.0
) -> BeliefPlace | None:
    """Return the place of a point: the surface below it, else a container, else the room; or None.

    The point (3,) is the middle or the foot of an object of a height, metres in the map's frame. In
    the air, where nothing carries it, there is no place: more than `ABOVE` over a surface.
    """
    x, y, z = (float(v) for v in np.asarray(point, float))
    here = shapely.Point(x, y)
    places = [*places]
    below = [
        (surface.height, place)
        for place in places
        if place.kind != "room"
        for surface in place.surfaces
        if -BELOW <= z - surface.height <= max(ABOVE, height / 2)
        and surface.outline.distance(here) <= BORDER
    ]
    if below:
        return max(below, key=lambda found: found[0])[1]
    around = place_around(places, point)
    if around is None or around.kind != "room" or around.low is None:
        return around
    return around if z - around.low[2] <= max(ABOVE, height) else None


def place_around(places: Iterable[BeliefPlace], point: ArrayLike) -> BeliefPlace | None:
    """Return the container in which a point (3,) is, else the room, also high up in it; or None."""
    x, y, z = (float(v) for v in np.asarray(point, float))
    here = shapely.Point(x, y)
    around = [
        (_volume(place), place)
        for place in places
        if (place.stores or place.kind == "room")
        and place.low is not None
        and place.high is not None
        and place.footprint is not None
        and place.footprint.distance(here) <= (0.0 if place.kind == "room" else BORDER)
        and place.low[2] - BELOW <= z <= place.high[2] + BELOW
    ]
    inside = [found for found in around if found[1].kind != "room"] or around
    return min(inside, key=lambda found: found[0])[1] if inside else None


def surface_below(
    places: Iterable[BeliefPlace], point: ArrayLike
) -> tuple[BeliefPlace, float] | None:
    """Return the place with the next surface below a point (3,), and the metres to it; or None."""
    x, y, z = (float(v) for v in np.asarray(point, float))
    here = shapely.Point(x, y)
    below = [
        (z - surface.height, place)
        for place in places
        for surface in place.surfaces
        if surface.height <= z and surface.outline.distance(here) <= BORDER
    ]
    if not below:
        return None
    away, place = min(below, key=lambda found: found[0])
    return place, away


def _volume(place: BeliefPlace) -> float:
    assert place.low is not None
    assert place.high is not None
    return float(np.prod(place.high - place.low))


class PlacePoints(NamedTuple):
    """Points at which an object may be at a place, evenly over its surfaces and in its volume."""

    at: NDArray[np.float64]  # (n, 3) metres in the map's frame
    weight: NDArray[np.float64]  # (n,) P(point | place); sums to 1
    within: NDArray[np.bool_]  # (n,) in the volume of one that stores, below its top


def sample_points(place: BeliefPlace, step: float, lift: float) -> PlacePoints:
    """Return points over the surfaces of a place, and in the volume of one that stores.

    A view of the top of a closed cabinet shows a part of the place, not all of it. `step` metres
    are between the points, `lift` metres above the surface: half the height of the object. In a
    volume, they are at several levels, up to `LEVEL` apart, all as likely: boards are not known.
    """
    areas = [(s.outline, s.height + lift, s.weight * s.outline.area) for s in place.surfaces]
    inside = place.stores or not areas
    if inside and place.footprint is not None and place.low is not None and place.high is not None:
        levels = _middles(float(place.low[2]), float(place.high[2]), LEVEL)
        weight = place.inside * place.footprint.area / len(levels)
        areas += [(place.footprint, float(z), weight) for z in levels]
    if not areas:
        return PlacePoints(np.empty((0, 3)), np.empty(0), np.empty(0, np.bool_))
    parts = [_grid(outline, height, step) for outline, height, _ in areas]
    weights = [np.full(len(p), w / len(p)) for p, (_, _, w) in zip(parts, areas, strict=True)]
    at, weight = np.concatenate(parts), np.concatenate(weights)
    within = np.arange(len(at)) >= sum(map(len, parts[: len(place.surfaces)]))
    if place.stores:
        for surface in place.surfaces:
            below = at[:, 2] - lift < surface.height - BELOW
            within |= below & shapely.contains_xy(surface.outline, at[:, :2])
    whole = weight.sum()
    return PlacePoints(at, weight / whole if whole > 0 else np.full(len(at), 1 / len(at)), within)


def _grid(outline: shapely.Geometry, height: float, step: float) -> NDArray[np.float64]:
    x0, y0, x1, y1 = outline.bounds
    x, y = np.meshgrid(_middles(x0, x1, step), _middles(y0, y1, step))
    inside = shapely.contains_xy(outline, x.ravel(), y.ravel())
    points = np.column_stack([x.ravel()[inside], y.ravel()[inside]])
    if not len(points):
        middle = outline.representative_point()
        points = np.array([[middle.x, middle.y]])
    return np.column_stack([points, np.full(len(points), height)])


def _middles(low: float, high: float, step: float) -> NDArray[np.float64]:
    """The middles of equal parts of an interval that are at most a step long."""
    count = max(int(np.ceil((high - low) / step)), 1)
    return low + (np.arange(count) + 0.5) * (high - low) / count
