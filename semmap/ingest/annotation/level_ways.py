"""Ways between the levels of indoor formats: stairs, ramps and escalators, and doors of lifts."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely
from shapely import LineString

from semmap.ingest.annotation.feature_file import Feature

WAYS = {
    "escalator": "escalator",
    "movingwalkway": "ramp",
    "ramp": "ramp",
    "stairs": "stairs",
    "steps": "stairs",
}
"""The type of the way of each word of OpenStreetMap and IMDF for a thing that leads up."""

INSIDE = 0.8
"""The part of an area's length that the way through it is long, so that it ends in it."""


MARGIN = 0.5
"""Metres from its border at which a way ends in an area; shorter ways are none."""

BESIDE = 0.2
"""Metres from a cabin within which the middle of a door leads into it."""


def leads_into(cabins: Iterable[shapely.Geometry], door: LineString) -> bool:
    """Return whether a door is that of one of the cabins of lifts."""
    return any(cabin.distance(door.centroid) <= BESIDE for cabin in cabins)


def way_along(area: shapely.Geometry) -> LineString:
    """Return the line of the way through an area: along the rectangle around it."""
    corners = shapely.get_coordinates(area.minimum_rotated_rectangle)[:4]
    middle = corners.mean(axis=0)
    sides = sorted(itertools.pairwise(corners), key=lambda s: float(np.ptp(s, 0).sum()))
    half = INSIDE * (sides[0][0] + sides[0][1] - 2 * middle) / 2
    return LineString([middle + half, middle - half])


def way_between(first: shapely.Geometry, second: shapely.Geometry) -> LineString:
    """Return the line of the way from an area to another: through the first if it is below it."""
    inner = second.buffer(-MARGIN)
    line = shapely.shortest_line(first.centroid, second if inner.is_empty else inner)
    return line if line.length > MARGIN else way_along(first)


def way_feature(
    where: str, line: LineString, joins: tuple[str, str], storey: str, type_: str, **more: Any
) -> Feature:
    """Return the connector of a way from a room of a storey to a room of another."""
    about = {"kind": "connector", "type": type_, "joins": [*joins], "storey": storey, **more}
    return Feature(where, None, line, about)
