"""Faces that are connected with a floor by low steps and gentle slopes."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from shapely import STRtree, polygons

GAP = 0.005
"""Largest gap between connected faces, seen from above, metres."""

EXACT = 0.001
"""Metres by which a step may exceed the highest one: heights in files are rounded."""


def walked_faces(
    triangles: NDArray[np.float64],
    floors: Iterable[float],
    max_step: float,
    max_slope: float,
    among: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Return (F,) whether each face is reached from a floor by walking on faces (F, 3, 3), metres.

    Faces are of either orientation, because real meshes mix both, and tilted by up to `max_slope`
    radians; those that touch, seen from above, are up to a step apart. Walking begins at `floors`,
    heights, on faces within a step of them. `among` (F,) limits the faces.
    """
    low, high = triangles[:, :, 2].min(axis=1), triangles[:, :, 2].max(axis=1)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    gentle = (lengths > 1e-10) & (np.abs(normals[:, 2]) >= math.cos(max_slope) * lengths)
    if among is not None:
        gentle &= among
    heights = set(floors)
    step = max_step + EXACT
    start = np.zeros(len(triangles), np.bool_)
    for floor in heights:
        start |= gentle & (low < floor + step) & (high > floor - step)
    found = start.copy()
    some = np.flatnonzero(gentle & _within_steps(low, high, gentle, heights, step))
    if start[some].all():
        return found
    from scipy.sparse import coo_array  # slow to load
    from scipy.sparse.csgraph import connected_components

    shapes = polygons(triangles[some][:, :, :2])
    one, other = STRtree(shapes).query(shapes, predicate="dwithin", distance=GAP)
    rise = np.maximum(low[some[one]], low[some[other]]) - np.minimum(
        high[some[one]], high[some[other]]
    )
    joined = rise <= step
    graph = coo_array(
        (np.ones(int(joined.sum()), bool), (one[joined], other[joined])), shape=(len(some),) * 2
    )
    part = connected_components(graph, directed=False)[1]
    found[some[np.isin(part, part[start[some]])]] = True
    return found


def _within_steps(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    gentle: NDArray[np.bool_],
    floors: Iterable[float],
    max_step: float,
) -> NDArray[np.bool_]:
    """Return (F,) whether gentle faces of other heights could lead from a floor to each face."""
    tenths = np.rint(np.column_stack([low[gentle], high[gentle]]) * 1e4).astype(np.int64)
    _, one = np.unique(tenths[:, 0] * 2**32 + tenths[:, 1], return_index=True)
    spans = tenths[one] / 1e4
    found = np.zeros(len(low), np.bool_)
    for floor in floors:
        bottom, top, grown = floor, floor, True
        while grown:
            near = (spans[:, 0] <= top + max_step + 1e-4) & (
                spans[:, 1] >= bottom - max_step - 1e-4
            )
            reach = (
                min(bottom, float(spans[near, 0].min(initial=bottom))),
                max(top, float(spans[near, 1].max(initial=top))),
            )
            grown = reach != (bottom, top)
            bottom, top = reach
        found |= (low >= bottom - 1e-4) & (high <= top + 1e-4)
    return found
