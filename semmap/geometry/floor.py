"""Walkable floor: what of a room's ground one can stand on (Deeken et al., section 3.4)."""

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
from semmap.geometry.walk import GAP, walked_faces

__all__ = ["Floor", "shadow", "walkable_floor"]

THIN = 1e-3
"""Metres that a sheet without thickness takes to either side."""


@dataclass(frozen=True, eq=False)
class Floor:
    """A walkable floor: its outline on the ground and the lowest and highest z under it, metres."""

    outline: Polygon | MultiPolygon
    low: float
    high: float


def shadow(mesh: Mesh, low: float, high: float, *, fill: bool) -> Polygon | MultiPolygon:
    """What of a mesh lies between two heights, seen from above.

    Parameters
    ----------
    fill : whether a ring of faces around a place takes that place, too. Otherwise only the inside
        of a closed mesh is taken: a wall's, and not the room's that an open shell encloses.
    """
    if not len(mesh.faces):
        return Polygon()
    mesh = Mesh(np.round(mesh.vertices, 9), mesh.faces)
    corners = np.round(_between(mesh, low, high), 9)
    flat = shapely.polygons(corners[:, :, :2])
    upright = shapely.area(flat) <= 1e-8
    if fill:
        inside = [Polygon(p.exterior) for p in _enclosed(_section(mesh, low)[0])]
    else:
        part, closed = closed_parts(mesh)
        lines, outward = _section(Mesh(mesh.vertices, mesh.faces[closed[part]]), low)
        places = _enclosed(lines)
        points = shapely.get_coordinates(shapely.point_on_surface(places))
        inside = [p for p, w in zip(places, _winding(points, lines, outward), strict=True) if w]
    area = shapely.union_all([*flat[~upright], *inside])
    edges = _longest_edges(corners[upright, :, :2])
    sheets = shapely.buffer(edges[~shapely.covers(area.buffer(1e-6), edges)], THIN)
    return shapely.union_all([area, *sheets])


def _between(mesh: Mesh, low: float, high: float) -> NDArray[np.float64]:
    """(N, 3, 3): what of the faces lies between two heights, as triangles."""
    from trimesh.intersections import slice_faces_plane  # slow to load; few commands need it

    vertices, faces = mesh.vertices, np.asarray(mesh.faces, np.int64)
    for side, at in ((1, low), (-1, high)):
        if len(faces):
            vertices, faces, _ = slice_faces_plane(  # type: ignore[no-untyped-call]
                vertices, faces, (0, 0, side), (0, 0, at)
            )
    return np.asarray(vertices)[faces]


def _section(mesh: Mesh, height: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The lines (N, 2, 2) in which a mesh is cut, and (N, 2) which way its faces look there."""
    triangles = mesh.triangles
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
    """The polygons into which lines cut the plane."""
    net = shapely.union_all(shapely.linestrings(lines), grid_size=1e-7)
    places: NDArray[np.object_] = shapely.get_parts(shapely.polygonize(shapely.get_parts(net)))
    return places


def _winding(
    points: NDArray[np.float64], lines: NDArray[np.float64], outward: NDArray[np.float64]
) -> NDArray[np.int64]:
    """(P,): how often the lines go around a point: what a ray to +x leaves, less what it enters."""
    a, b = lines[:, 0], lines[:, 1]
    turns = np.zeros(len(points), np.int64)
    for k, (x, y) in enumerate(points):
        met = np.flatnonzero((a[:, 1] > y) != (b[:, 1] > y))
        share = (y - a[met, 1]) / (b[met, 1] - a[met, 1])
        right = a[met, 0] + share * (b[met, 0] - a[met, 0]) > x
        turns[k] = np.sign(outward[met[right], 0]).sum()
    return turns


def _longest_edges(corners: NDArray[np.float64]) -> NDArray[np.object_]:
    """The longest edge of each flat triangle (F, 3, 2), as a line."""
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
    """The part of a room's floor on which one can walk, or None.

    Parameters
    ----------
    ground : the room's outline, metres
    height : z of its floor
    room : its mesh; where there is none, the floor is the whole ground at `height`
    obstacles : what stands in it, in the same frame, each with whether its rings are filled
        (`shadow`)
    headroom : metres above the floor that have to be free
    max_step : metres that one steps up or down between faces; lower things are no obstacles
    max_slope : radians by which a face of the floor may be tilted
    min_area : square metres below which a part is no floor

    Notes
    -----
    Of a mesh, the floor is the faces within `max_slope`, whichever way they look (meshes from the
    wild look both ways), that hang together, by steps of at most `max_step`, with one at `height`.

    Raises
    ------
    ValueError
        A headroom that is not above the step, or a negative step.
    """
    if not 0 <= max_step < headroom:
        raise ValueError(f"a step of {max_step} m under a headroom of {headroom} m: give 0 <= step")
    if room is None or not len(room.faces):
        levels = [_Level(ground, height, height, frozenset())]
        solids: list[Mesh] = []
        sheets: list[tuple[Mesh, bool]] = []
    else:
        levels, solids, others = _levels(room, height, max_step, max_slope, ground.area / 2)
        sheets = [(others, False)]
    free = []
    for level in levels:
        place = level.outline.intersection(ground)
        own = [(s, True) for number, s in enumerate(solids) if number not in level.tops_of]
        for mesh, fill in [*obstacles, *own, *sheets]:
            if not place.is_empty:
                above = shadow(mesh, level.low + max_step, level.high + headroom, fill=fill)
                place = place.difference(above)
        free.append((place, level.low, level.high))
    whole = shapely.union_all([place for place, _, _ in free])
    kept = [p for p in polygons(without_gaps(whole, GAP)) if p.area >= min_area]
    if not kept:
        return None
    outline = shapely.union_all(kept)
    under = [(a, b) for place, a, b in free if place.intersects(outline)]
    return Floor(outline, min(a for a, _ in under), max(b for _, b in under))


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
    """The levels of the floor, the room's solids, and what is neither floor nor solid."""
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
    others = np.setdiff1d(np.flatnonzero(solid < 0), walked)
    return (
        [
            _Level(shapely.union_all(shapes[k]), a, b, frozenset(solid[walked[k]].tolist()))
            for (a, b), k in sorted(levels.items())
        ],
        [Mesh(room.vertices, room.faces[solid == n]) for n in range(solid.max(initial=-1) + 1)],
        Mesh(room.vertices, room.faces[others]),
    )


def _solids(room: Mesh, too_large: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """(F,) each: the solid that a face is of, or -1; 1 where its normal looks outward, else -1.

    A solid is a closed part that takes less than `too_large` square metres: a pillar, a platform.
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
