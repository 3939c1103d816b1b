"""Walkable floor of a room (Deeken et al., section 3.4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semmap.geometry.mesh import Mesh
from semmap.geometry.morphology import polygons, without_gaps
from semmap.geometry.parts import closed_parts
from semmap.geometry.walk import EXACT, GAP, walked_faces

THIN = 1e-3
"""Thickness of a sheet to either side, metres."""

GRID = 1e-4
"""Metres between the points of the grid of outlines; without one, GEOS unites not all of them."""


@dataclass(frozen=True, eq=False)
class Floor:
    """A walkable floor: its outline on the ground and the lowest and highest z under it, metres."""

    outline: Polygon | MultiPolygon
    low: float
    high: float


def shadow(mesh: Mesh, low: float, high: float, *, fill: bool) -> Polygon | MultiPolygon:
    """Return the part of a mesh between two heights, seen from above.

    With `fill`, the inside of any ring of faces counts; else only that of a closed mesh does: that
    of a wall, not that of a room within an open shell.
    """
    if not len(mesh.faces):
        return Polygon()
    mesh = Mesh(np.round(mesh.vertices, 9), mesh.faces)
    corners = np.round(_between(mesh, low, high), 9)
    flat = shapely.polygons(corners[:, :, :2])
    upright = shapely.area(flat) <= 1e-8
    if fill:
        inside = [Polygon(p.exterior) for p in _enclosed(section(mesh.triangles, low)[0])]
    else:
        part, closed = closed_parts(mesh)
        lines, outward = section(mesh.triangles[closed[part]], low)
        places = _enclosed(lines)
        points = shapely.get_coordinates(shapely.point_on_surface(places))
        inside = [p for p, w in zip(places, _winding(points, lines, outward), strict=True) if w]
    area = shapely.union_all([*flat[~upright], *inside])
    edges = _longest_edges(corners[upright, :, :2])
    sheets = shapely.buffer(edges[~shapely.covers(area.buffer(1e-6), edges)], THIN)
    return shapely.union_all([area, *sheets])


def _between(mesh: Mesh, low: float, high: float) -> NDArray[np.float64]:
    """Return (N, 3, 3) the parts of the faces between two heights, as triangles."""
    from trimesh.intersections import slice_faces_plane  # slow to load; few commands need it

    vertices, faces = mesh.vertices, np.asarray(mesh.faces, np.int64)
    for side, at in ((1, low), (-1, high)):
        if len(faces):
            vertices, faces, _ = slice_faces_plane(  # type: ignore[no-untyped-call]
                vertices, faces, (0, 0, side), (0, 0, at)
            )
    return np.asarray(vertices)[faces]


def section(
    triangles: NDArray[np.float64], height: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lines (N, 2, 2) in which triangles (M, 3, 3) cross a height, and their normals."""
    above = triangles[:, :, 2] > height
    cut = above.any(axis=1) & ~above.all(axis=1)
    triangles, above = triangles[cut], above[cut]
    one_above = above.sum(axis=1) == 1
    alone = np.where(one_above, above.argmax(axis=1), (~above).argmax(axis=1))
    p, q, r = (triangles[np.arange(len(alone)), (alone + k) % 3] for k in range(3))
    ends = [
        p[:, :2] + ((height - p[:, 2]) / (far[:, 2] - p[:, 2]))[:, None] * (far - p)[:, :2]
        for far in (q, r)
    ]
    return np.stack(ends, axis=1), np.cross(q - p, r - p)[:, :2]


def _enclosed(lines: NDArray[np.float64]) -> NDArray[np.object_]:
    """Return the polygons into which lines divide the plane."""
    net = shapely.union_all(shapely.linestrings(lines), grid_size=1e-7)
    places: NDArray[np.object_] = shapely.get_parts(shapely.polygonize(shapely.get_parts(net)))
    return places


def _winding(
    points: NDArray[np.float64], lines: NDArray[np.float64], outward: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return (P,) how often the lines go around each point, counted along a ray to +x."""
    a, b = lines[:, 0], lines[:, 1]
    turns = np.zeros(len(points), np.int64)
    for k, (x, y) in enumerate(points):
        met = np.flatnonzero((a[:, 1] > y) != (b[:, 1] > y))
        share = (y - a[met, 1]) / (b[met, 1] - a[met, 1])
        right = a[met, 0] + share * (b[met, 0] - a[met, 0]) > x
        turns[k] = np.sign(outward[met[right], 0]).sum()
    return turns


def _longest_edges(corners: NDArray[np.float64]) -> NDArray[np.object_]:
    """Return the longest edge of each flat triangle (F, 3, 2), as a line."""
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
    lengths = np.linalg.norm(edges[:, :, 1] - edges[:, :, 0], axis=2)
    longest = edges[np.arange(len(edges)), lengths.argmax(axis=1)]
    lines: NDArray[np.object_] = shapely.linestrings(longest[lengths.max(axis=1) > 1e-7])
    return lines


def walkable_floor(
    ground: Polygon | MultiPolygon,
    height: float,
    room: Mesh | None,
    obstacles: Sequence[tuple[Mesh, bool]],
    *,
    headroom: float = 2.0,
    max_step: float = 0.03,
    max_slope: float = math.radians(10),
    min_area: float = 0.05,
) -> Floor | None:
    """Return the part of a room's floor that can be walked on, or None.

    It is the faces of `room` within `max_slope` radians, of either orientation, that are connected,
    by steps of at most `max_step` metres, with a face at `height`; without a mesh, all of `ground`
    at this height. Outlines are on a grid of 0.1 mm, on which GEOS unites all floors; steps may
    be 1 mm higher. `headroom` metres above it are free of the obstacles, each a mesh with
    `fill` as in `shadow`. Parts below `min_area` square metres are left out. Raises ValueError: the
    headroom is not above the step, or the step is negative.
    """
    if not 0 <= max_step < headroom:
        raise ValueError(
            f"a step of {max_step} m and a headroom of {headroom} m: give 0 <= step < headroom"
        )
    if room is None or not len(room.faces):
        levels = [_Level(ground, height, height, frozenset())]
        solids: list[Mesh] = []
        sheets: list[tuple[Mesh, bool]] = []
    else:
        levels, solids, others = _levels(room, height, max_step, max_slope, ground.area / 2)
        sheets = [(others, False)]
    free = []
    for level in levels:
        place = _areas(shapely.intersection(level.outline, ground, grid_size=GRID))
        own = [(s, True) for number, s in enumerate(solids) if number not in level.tops_of]
        for mesh, fill in [*obstacles, *own, *sheets]:
            if not place.is_empty:
                above = shadow(mesh, level.low + max_step + EXACT, level.high + headroom, fill=fill)
                place = _areas(shapely.difference(place, above, grid_size=GRID))
        free.append((place, level.low, level.high))
    whole = shapely.union_all([place for place, _, _ in free], grid_size=GRID)
    kept = [p for p in polygons(without_gaps(whole, GAP)) if p.area >= min_area]
    if not kept:
        return None
    outline = shapely.union_all(kept, grid_size=GRID)
    under = [(a, b) for place, a, b in free if place.intersects(outline)]
    return Floor(outline, min(a for a, _ in under), max(b for _, b in under))


def _areas(shape: shapely.Geometry) -> MultiPolygon:
    """Return the polygons of a shape, which a grid may give lines and points, too."""
    return MultiPolygon(polygons(shape))


@dataclass(frozen=True, eq=False)
class _Level:
    """Faces of a floor from z `low` to `high`, and the solids of the room whose tops they are."""

    outline: Polygon | MultiPolygon
    low: float
    high: float
    tops_of: frozenset[int]


def _levels(
    room: Mesh, height: float, max_step: float, max_slope: float, too_large: float
) -> tuple[list[_Level], list[Mesh], Mesh]:
    """Return the levels of the floor, the room's solids, and the remaining faces."""
    triangles = room.triangles
    solid, upward = _solids(room, too_large)
    up = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])[:, 2]
    walked = np.flatnonzero(
        walked_faces(triangles, [height], max_step, max_slope, (solid < 0) | (upward * up > 0))
    )
    shapes = shapely.polygons(triangles[walked][:, :, :2])
    low, high = triangles[walked, :, 2].min(axis=1), triangles[walked, :, 2].max(axis=1)
    levels: dict[tuple[float, float], list[int]] = {}
    for k in range(len(walked)):
        levels.setdefault((round(low[k], 3), round(high[k], 3)), []).append(k)
    others = np.setdiff1d(np.flatnonzero(solid < 0), walked, assume_unique=True)
    return (
        [
            _Level(
                shapely.union_all(shapes[k], grid_size=GRID),
                a,
                b,
                frozenset(solid[walked[k]].tolist()),
            )
            for (a, b), k in sorted(levels.items())
        ],
        [Mesh(room.vertices, room.faces[solid == n]) for n in range(solid.max(initial=-1) + 1)],
        Mesh(room.vertices, room.faces[others]),
    )


def _solids(room: Mesh, too_large: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return, for each face, its solid or -1, and 1 where its normal points outward, else -1.

    A solid is a closed part that covers less than `too_large` square metres: a pillar, a platform.
    A larger one is the room's shell.
    """
    part, closed = closed_parts(room)
    solid = np.full(len(room.faces), -1)
    outward = np.ones(len(room.faces))
    count = 0
    for number in np.flatnonzero(closed):
        faces = part == number
        triangles = room.triangles[faces]
        if np.prod(np.ptp(triangles[:, :, :2], axis=(0, 1))) < too_large:
            a, b, c = np.moveaxis(triangles - triangles[0, 0], 1, 0)
            solid[faces] = count
            outward[faces] = np.sign(np.einsum("ij,ij->", a, np.cross(b, c)))
            count += 1
    return solid, outward
