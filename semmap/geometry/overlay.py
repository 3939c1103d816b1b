"""Intersection, union and difference of areas on a grid of a micrometre.

Without a grid, GEOS (seen in 3.11 and 3.14) takes two rooms for the same that share an edge whose
corners differ in their last digits: their intersection is one of them, and so is their union.
"""

from __future__ import annotations

from collections.abc import Iterable

import shapely
from shapely.geometry.base import BaseGeometry

GRID = 1e-6
"""Metres between the points of the grid."""


def common(a: BaseGeometry, b: BaseGeometry) -> BaseGeometry:
    """Return the intersection of two shapes."""
    return shapely.intersection(a, b, grid_size=GRID)


def united(shapes: Iterable[BaseGeometry]) -> BaseGeometry:
    """Return the union of shapes; of none, an empty one."""
    return shapely.union_all([*shapes], grid_size=GRID)


def without(a: BaseGeometry, b: BaseGeometry) -> BaseGeometry:
    """Return the first shape without the second one."""
    return shapely.difference(a, b, grid_size=GRID)
