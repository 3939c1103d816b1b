"""The height of a floor, measured on meshes where the map does not state it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

LEVEL = math.radians(6)  # slope up to which a face is level
THICKNESS = 0.02  # metres of height within which level faces make one surface

LOWEST_CEILING = 1.5
"""Metres above a surface within which a surface of the same width is the top of the same slab."""

DEEPEST = 0.5
"""Metres above the lowest point of all within which a surface may be a floor, without ground."""

SAME_WIDTH = 0.7  # share of the lower surface's area, with the tops of walls, that a slab's has


def floor_level(
    ground: Sequence[NDArray[np.float64]],
    bodies: Sequence[NDArray[np.float64]] = (),
    *,
    near: tuple[float, float] | None = None,
) -> float | None:
    """Return the height of the floor that meshes show, metres, the lowest of several storeys.

    It is the widest level surface of the ground, (F, 3, 3) triangles. Without ground it is a level
    surface near the lowest point of the bodies that is half as wide as all of them together;
    without such a surface it is the height at which most bodies stand. None where there are no
    triangles, or no floor within `near`.
    """
    known = _lowest_surface(_joined(ground), near)
    if known is not None:
        return known
    solids = [triangles for triangles in bodies if len(triangles)]
    if not solids:
        return None
    every = _joined(solids)
    hull = shapely.multipoints(every[:, :, :2].reshape(-1, 2)).convex_hull  # however it is turned
    low = float(every[:, :, 2].min())
    wide = _lowest_surface(every, near or (low, low + DEEPEST), least=hull.area / 2)
    if wide is not None:
        return wide
    feet = np.array([triangles[:, :, 2].min() for triangles in solids])
    if near is not None:
        feet = feet[(feet >= near[0]) & (feet <= near[1])]
    if not len(feet):
        return None
    heights, counts = np.unique(np.round(feet, 2), return_counts=True)
    common = heights[counts.argmax()]
    return float(np.median(feet[np.round(feet, 2) == common]))


def _joined(parts: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.concatenate([*parts, np.empty((0, 3, 3))])


def _lowest_surface(
    triangles: NDArray[np.float64], near: tuple[float, float] | None, least: float = 0.0
) -> float | None:
    """The top of the lowest level surface that is about as wide as the widest one.

    A slab has a surface below and one above: the upper one counts, and a thin one is no wider for
    having both. No surface is less than `least` square metres.
    """
    heights, areas = _level_faces(triangles)
    if near is not None:
        within = (heights >= near[0]) & (heights <= near[1])
        heights, areas = heights[within], areas[within]
    if not len(heights):
        return None
    order = np.argsort(heights)
    heights, areas = heights[order], areas[order]
    ends = np.searchsorted(heights, heights + THICKNESS, side="right")
    sides = np.stack([np.maximum(areas, 0), np.maximum(-areas, 0)])
    total = np.pad(np.cumsum(sides, axis=1), ((0, 0), (1, 0)))
    widths = (total[:, ends] - total[:, :-1]).max(axis=0)
    if widths.max() < max(least, 1e-9):
        return None
    wide = np.flatnonzero(widths >= max(least, widths.max() / 2))
    tops = heights[ends[wide] - 1]
    above = (tops <= tops[0] + LOWEST_CEILING) & (widths[wide] >= SAME_WIDTH * widths[wide[0]])
    return float(tops[above].max())


def _level_faces(triangles: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The middle heights and areas of level faces; areas of those that look down are < 0."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    level = (lengths > 1e-12) & (np.abs(normals[:, 2]) >= math.cos(LEVEL) * lengths)
    return triangles[level][:, :, 2].mean(axis=1), normals[level, 2] / 2
