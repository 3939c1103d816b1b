"""The heights of doorways: the undersides of walls above them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString

ALONG = (0.3, 0.4, 0.5, 0.6, 0.7)
"""Where a doorway is measured, as parts of the line from post to post."""

THICK = (-0.04, 0.0, 0.04)
"""Metres across that line, in the wall."""

BEFORE = 0.6
"""Metres across that line at which the ceiling of the room before a doorway is."""

FROM = 1.0
"""Metres above the floor from which on one looks up."""

LOWER = 0.05
"""Metres by which a lintel is lower than the ceiling before it, at least."""


def lintel_heights(
    lines: Sequence[LineString], triangles: NDArray[np.float64], floor: float
) -> list[float | None]:
    """Return metres from the floor to the lintel over each line, to 1 mm.

    `triangles` (N, 3, 3) are those of the walls. A height is None where most of a doorway is open,
    up to the ceiling on both sides.
    """
    level = np.abs(_normals(triangles)[:, 2]) > 1e-9
    seen = triangles[level & (triangles[..., 2].max(axis=1) > floor + FROM)]
    tree = shapely.STRtree(shapely.polygons(seen[..., :2]))
    return [_height(line, seen, tree, floor) for line in lines]


def _height(
    line: LineString, triangles: NDArray[np.float64], tree: shapely.STRtree, floor: float
) -> float | None:
    ends = shapely.get_coordinates(line)[[0, -1]]
    way = ends[1] - ends[0]
    length = float(np.hypot(*way))
    if length == 0:
        return None
    across = np.array([-way[1], way[0]]) / length
    middle = ends[0] + np.array(ALONG)[:, None] * way
    over, *ceilings = (
        float(np.median([_first(at, triangles, tree, floor) for each in each_side for at in each]))
        for each_side in (
            [middle + away * across for away in THICK],
            [middle - BEFORE * across],
            [middle + BEFORE * across],
        )
    )
    return round(over - floor, 3) if over < max(ceilings) - LOWER else None


def _first(
    at: NDArray[np.float64], triangles: NDArray[np.float64], tree: shapely.STRtree, floor: float
) -> float:
    """The z of the lowest triangle above a point (2,), infinite where there is none."""
    near = triangles[tree.query(shapely.Point(at), predicate="intersects")]
    normals = _normals(near)
    z = near[:, 0, 2] - ((at - near[:, 0, :2]) * normals[:, :2]).sum(axis=1) / normals[:, 2]
    return float(z[z > floor + FROM].min(initial=np.inf))


def _normals(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
