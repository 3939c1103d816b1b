"""Closing and opening of polygons: bridge gaps, drop slivers, keep the rest.

GEOS sometimes treats a shape as a hole and shrinks it to nothing; this module detects that. It
unites all shapes on a fine grid; without one, nearly equal edges are an error at times.
"""

from __future__ import annotations

import math

import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

FINE = 1e-6
"""Metres between the points of that grid."""


def polygons(shape: BaseGeometry) -> list[Polygon]:
    """Return the polygons of a shape, without its lines and points."""
    return [p for p in shapely.get_parts(shape) if p.geom_type == "Polygon"]


def areas_within(outline: BaseGeometry, least: float) -> list[Polygon]:
    """Return the areas of at least `least` square metres that an outline encloses.

    They are several where it crosses itself, as in a figure of eight.
    """
    parts = shapely.get_parts(shapely.make_valid(outline))
    return [area for part in parts for area in polygons(part) if area.area > least]


def without_gaps(shape: BaseGeometry, gap: float) -> Polygon | MultiPolygon:
    """Return the shape with gaps narrower than `gap` metres closed."""
    parts: list[Polygon] = []
    for grown in polygons(shape.buffer(gap / 2, join_style="mitre")):
        closed = _shrunk(grown, gap / 2)
        parts += polygons(shape.intersection(grown)) if closed is None else closed
    return shapely.union_all(parts, grid_size=FINE) if parts else Polygon()


def without_slivers(shape: BaseGeometry, width: float) -> Polygon | MultiPolygon:
    """Return the shape without parts narrower than `width` metres."""
    parts: list[Polygon] = []
    for part in polygons(shape):
        thinner = _shrunk(part, width / 2)
        if thinner is None:
            parts.append(part)
            continue
        parts += polygons(shapely.MultiPolygon(thinner).buffer(width / 2, join_style="mitre"))
    return shapely.union_all(parts, grid_size=FINE) if parts else Polygon()


def _shrunk(polygon: Polygon, by: float) -> list[Polygon] | None:
    """Return the area further than `by` inside; None where GEOS lost more than is possible."""
    inner = polygons(polygon.buffer(-by, join_style="mitre"))
    # The strip along a line of length l that is lost is no larger than 2 l by + pi by^2.
    lost = 2 * by * polygon.length + math.pi * by**2 * (1 + len(polygon.interiors))
    return inner if polygon.area - sum(p.area for p in inner) <= lost else None
