"""Closing and opening of polygons: gaps bridged, slivers dropped, and nothing lost besides.

GEOS now and then takes a shape for a hole and shrinks it to nothing; what cannot be is seen here.
"""

from __future__ import annotations

import math

import shapely
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

__all__ = ["polygons", "without_gaps", "without_slivers"]


def polygons(shape: BaseGeometry) -> list[Polygon]:
    """The polygons of a shape; lines and points of it are left out."""
    return [p for p in shapely.get_parts(shape) if p.geom_type == "Polygon"]


def without_gaps(shape: BaseGeometry, gap: float) -> Polygon | MultiPolygon:
    """The shape with gaps narrower than `gap` metres closed."""
    grown = shape.buffer(gap / 2, join_style="mitre")
    return shapely.union_all([*polygons(_shrunk(grown, gap / 2)), *polygons(shape)])


def without_slivers(shape: BaseGeometry, width: float) -> Polygon | MultiPolygon:
    """The shape without what is narrower than `width` metres."""
    return _shrunk(shape, width / 2).buffer(width / 2, join_style="mitre")


def _shrunk(shape: BaseGeometry, by: float) -> Polygon | MultiPolygon:
    parts = []
    for part in polygons(shape):
        inner = part.buffer(-by, join_style="mitre")
        # The strip along a line of length l that is lost is no larger than 2 l by + pi by^2.
        rings = 1 + len(part.interiors)
        lost = 2 * by * part.length + math.pi * by**2 * rings
        parts += polygons(inner) if part.area - inner.area <= lost else [part]
    return shapely.union_all(parts) if parts else Polygon()
