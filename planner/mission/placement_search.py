"""Finds a free spot on a surface to put an object down."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely

from semmap.geometry.overlay import united, without

STEP = 0.05  # metres between the spots that are tried


def find_free_spot(
    surface: shapely.Geometry,
    occupied: Iterable[shapely.Geometry],
    radius: float,
    towards: tuple[float, float],
) -> tuple[float, float] | None:
    """(x, y) of the free spot of a surface that is nearest to a point; None without one, metres.

    A circle of the radius around it lies on the surface and touches no occupied footprint.
    """
    free = surface.buffer(-radius)
    taken = united(k for k in occupied if not k.is_empty)
    if not taken.is_empty:
        free = without(free, taken.buffer(radius + 0.01))
    if free.is_empty:
        return None
    x0, y0, x1, y1 = free.bounds
    x, y = (k.ravel() for k in np.meshgrid(np.arange(x0, x1, STEP), np.arange(y0, y1, STEP)))
    inside = shapely.contains_xy(free, x, y)
    if not inside.any():
        point = free.representative_point()
        return point.x, point.y
    x, y = x[inside], y[inside]
    nearest = int(np.argmin(np.hypot(x - towards[0], y - towards[1])))
    return float(x[nearest]), float(y[nearest])
