"""What touches and what overlaps: triangle meshes compared along vertical lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from semmap.arrays import Floats

Ints = NDArray[np.intp]

SPACING = 0.015
"""Metres between the vertical lines along which solids are compared."""

MOST_LINES = 40_000
"""Of a pair of solids; larger overlaps are compared along lines that are further apart."""

LINES_ACROSS = 24
"""Along the shorter side of a thing whose space is compared."""

SAMPLES = 200
"""Points of a surface from which distances are measured."""


def heights_at(points: Floats, triangles: Floats) -> Floats:
    """Return (P, F): the z at which the vertical line through a point meets a face, else NaN."""
    # upright faces have no height
    a, b, c = (triangles[:, k] for k in range(3))
    ab, ac = b - a, c - a
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    x, y = points[:, :1] - a[:, 0], points[:, 1:2] - a[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (x * ac[:, 1] - y * ac[:, 0]) / area
        v = (y * ab[:, 0] - x * ab[:, 1]) / area
        z = a[:, 2] + u * ab[:, 2] + v * ac[:, 2]
        inside = (u >= -1e-6) & (v >= -1e-6) & (u + v <= 1 + 1e-6) & (np.abs(area) > 1e-12)
    return np.where(inside, z, np.nan)


def touches(triangles: Floats, others: Floats, distance: float) -> bool:
    """Return whether a corner or middle of one mesh's faces is near a face of the other, metres."""
    return _near(triangles, others, distance) or _near(others, triangles, distance)


def _near(triangles: Floats, others: Floats, distance: float) -> bool:
    from trimesh.triangles import closest_point  # slow to load

    low, high = others.min(axis=(0, 1)) - distance, others.max(axis=(0, 1)) + distance
    points = np.concatenate([triangles.reshape(-1, 3), triangles.mean(axis=1)])
    points = points[((points >= low) & (points <= high)).all(axis=1)]
    points = points[:: max(1, len(points) // SAMPLES)]
    if not len(points):
        return False
    low, high = points.min(axis=0) - distance, points.max(axis=0) + distance
    faces = others[((others.max(axis=1) >= low) & (others.min(axis=1) <= high)).all(axis=1)]
    for point in points if len(faces) else ():
        at = closest_point(faces, np.broadcast_to(point, (len(faces), 3)))  # type: ignore[no-untyped-call]
        if (np.linalg.norm(at - point, axis=1) <= distance).any():
            return True
    return False


def overlap(
    first: Floats, second: Floats, low: Floats, high: Floats, tolerance: float
) -> tuple[Floats, float, float] | None:
    """Return the extents (3,) of what two solids share and its part of each, or None if it is thin.

    It is thin unless it contains a cube of `tolerance` metres (within the spacing of the lines).
    Faces (F, 3, 3) are those over the window from `low` to `high`, with normals outward or all
    inward. Solids are where they enter and leave a vertical line: an open sheet has no inside.
    """
    size = high - low
    spacing = max(SPACING, float(np.sqrt(size[0] * size[1] / MOST_LINES)))
    counts = (int(size[0] / spacing) + 1, int(size[1] / spacing) + 1)
    start = low[:2] + np.array([0.0031, 0.0047])  # off the round numbers of edges
    one, two = (_solid_parts(t, start, counts, spacing) for t in (first, second))
    begin = np.searchsorted(two[0], one[0], "left")
    count = np.searchsorted(two[0], one[0], "right") - begin
    left = np.repeat(np.arange(len(one[0])), count)
    right = np.arange(len(left)) - np.repeat(np.cumsum(count) - count, count)
    right += np.repeat(begin, count)
    bottom = np.maximum(one[1][left], two[1][right])
    top = np.minimum(one[2][left], two[2][right])
    common = np.maximum(top - bottom, 0)
    deep = common > tolerance
    thick = np.zeros(counts[0] * counts[1], bool)
    thick[one[0][left[deep]]] = True
    block = max(2, round(tolerance / spacing) + 1)
    if not binary_erosion(thick.reshape(counts), np.ones((block, block))).any():
        return None
    wide = (np.ptp(np.argwhere(thick.reshape(counts)), axis=0) + 1) * spacing
    extents = np.array([*wide, top[deep].max() - bottom[deep].min()])
    shares = [float(common.sum() / (part[2] - part[1]).sum()) for part in (one, two)]
    return extents, shares[0], shares[1]


def shared_columns(first: Floats, second: Floats) -> tuple[float, float]:
    """Return how deep two things share their space, metres, and the larger part of one of them.

    Things (F, 3, 3) are filled along each vertical line, from their lowest face to their highest,
    open meshes, too.
    """
    boxes = np.array([(t.min(axis=(0, 1)), t.max(axis=(0, 1))) for t in (first, second)])[:, :, :2]
    both = boxes[:, 0].max(axis=0), boxes[:, 1].min(axis=0)
    if (both[1] <= both[0]).any():
        return 0.0, 0.0
    (one, area), (two, _) = (_columns(t, *both) for t in (first, second))
    common = np.minimum(one[1], two[1]) - np.maximum(one[0], two[0])
    common = np.nan_to_num(common).clip(0)
    volumes = []
    for triangles, box in zip((first, second), boxes, strict=True):
        (bottom, top), own = _columns(triangles, *box)
        volumes.append(max(float(np.nansum(top - bottom)) * own, 1e-12))
    return float(common.max()), float(common.sum()) * area / min(volumes)


def _columns(triangles: Floats, low: Floats, high: Floats) -> tuple[Floats, float]:
    """The lowest and the highest z (2, N) along vertical lines over a window; each line's area."""
    size = high - low
    spacing = max(float(size.min()) / LINES_ACROSS, float(np.sqrt(size.prod() / MOST_LINES)), 1e-6)
    counts = (int(size[0] / spacing) + 1, int(size[1] / spacing) + 1)
    line, z, _ = _crossings(triangles, low + np.array([0.31, 0.47]) * spacing, counts, spacing)
    ends = np.full((2, counts[0] * counts[1]), np.nan)
    ends[0, line[::-1]], ends[1, line] = z[::-1], z  # along a line, heights increase
    return ends, spacing**2


def _solid_parts(
    triangles: Floats, start: Floats, counts: tuple[int, int], spacing: float
) -> tuple[Ints, Floats, Floats]:
    """The solid intervals along vertical lines: the line, the lower and the upper end of each."""
    line, z, enters = _crossings(triangles, start, counts, spacing)
    if not len(line):
        return line, z, z
    first = np.flatnonzero(np.diff(line, prepend=-1))
    total = np.cumsum(enters)
    before = np.repeat((total - enters)[first], np.diff([*first, len(line)]))
    depth = total - before
    last = np.append(first[1:], len(line)) - 1
    shut = np.repeat(depth[last] == 0, np.diff([*first, len(line)]))
    solid = np.flatnonzero(shut[:-1] & (depth[:-1] != 0) & (line[1:] == line[:-1]))
    return line[solid], z[solid], z[solid + 1]


def _crossings(
    triangles: Floats, start: Floats, counts: tuple[int, int], spacing: float
) -> tuple[Ints, Floats, Ints]:
    """Where faces meet vertical lines: the line, the z, 1 or -1 by the side; upwards by line."""
    flat = (triangles[:, :, :2] - start) / spacing
    low = np.maximum(np.ceil(flat.min(axis=1)), 0).astype(np.intp)
    high = np.minimum(np.floor(flat.max(axis=1)), np.array(counts) - 1).astype(np.intp)
    width, height = np.maximum(high - low + 1, 0).T
    face = np.repeat(np.arange(len(flat)), width * height)
    number = np.arange(len(face)) - np.repeat(
        np.cumsum(width * height) - width * height, width * height
    )
    column, row = low[face, 0] + number % width[face], low[face, 1] + number // width[face]
    a, b, c = (flat[face, k] for k in range(3))
    ab, ac = b - a, c - a
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    x, y = column - a[:, 0], row - a[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (x * ac[:, 1] - y * ac[:, 0]) / area
        v = (y * ab[:, 0] - x * ab[:, 1]) / area
        z0, z1, z2 = triangles[face, :, 2].T
        z = z0 + u * (z1 - z0) + v * (z2 - z0)
        met = (u >= 0) & (v >= 0) & (u + v <= 1) & (np.abs(area) > 1e-9)
    line, z, enters = (column * counts[1] + row)[met], z[met], np.where(area[met] < 0, 1, -1)
    order = np.lexsort((z, line))
    return line[order], z[order], enters[order]
