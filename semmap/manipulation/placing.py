"""Where an object can be put: spots on support surfaces that are large and free enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, Polygon

from semmap.arrays import Floats
from semmap.geometry.surfaces import LevelPatch
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.solids import solid_hull

TURNS = 8
"""Headings that are tried at each spot."""

ABOVE = 0.003
"""Metres by which an object is released above the surface."""


FIRM = np.radians(20)
"""An object that falls over at this tilt stands firmly."""

MARGIN = 0.01
"""The least distance to edges and obstacles, metres."""

LEAST = 0.05
"""The least stability."""

BASE = 0.003
"""Height of the part of an object that touches the surface, metres."""


@dataclass(frozen=True, eq=False)
class PlacePose:
    """A pose (4, 4) of an object's model on a surface, in the frame of the surfaces.

    `spot` is the middle of its outline; `clearance` the metres to the nearest edge or obstacle, and
    `quality` that by the radius of the object, at most 1.
    """

    pose: Floats
    spot: tuple[float, float]
    surface: int
    clearance: float
    quality: float


def place_candidates(
    vertices: Floats,
    upright: Floats,
    surfaces: Sequence[LevelPatch],
    obstacles: Floats,
    *,
    spacing: float = 0.04,
    at: Sequence[Floats] | None = None,
) -> list[PlacePose]:
    """Poses at which an object stands free on a surface, the ones with most room first.

    The object is (N, 3) vertices in its model's frame, which stands in the pose `upright` (4, 4);
    its place and heading are chosen here, or among `at`, (M, 3) x, y of the model's frame and turn
    for each surface. It stays `MARGIN` from edges and `obstacles`, triangles (F, 3, 3) of all else.
    """
    standing = vertices @ upright[:3, :3].T
    low, high = standing.min(axis=0), standing.max(axis=0)
    hull = shapely.convex_hull(shapely.multipoints(standing[:, :2]))
    if not isinstance(hull, Polygon) or hull.area == 0:
        raise ManipulationError("object: seen from above it has no area; give the mesh of a solid")
    middle = np.array(hull.centroid.coords[0])
    corners = shapely.get_coordinates(hull.exterior) - middle
    radius = float(np.linalg.norm(corners, axis=1).max())
    lowest, highest = obstacles[..., 2].min(axis=1), obstacles[..., 2].max(axis=1)
    found = []
    for number, surface in enumerate(surfaces):
        if surface.area < hull.area:
            continue
        bottom, top = surface.height + ABOVE, surface.height + ABOVE + high[2] - low[2] + MARGIN
        x0, y0, x1, y1 = surface.outline.bounds
        flat = obstacles[..., :2]
        near = (highest > bottom) & (lowest < top)
        near &= np.all(flat.max(axis=1) > (x0, y0), axis=1)
        near &= np.all(flat.min(axis=1) < (x1, y1), axis=1)
        edge, blocked = surface.outline, shapely.union_all(_outlines(flat[near]))
        shapely.prepare([edge, blocked])
        if at is None:
            spots, angles = _grid(edge, spacing)
        else:
            angles = at[number][:, 2]
            spots = at[number][:, :2] + middle @ _turns(angles)
        turns = _turns(angles)
        areas = shapely.polygons(corners @ turns + spots[:, None])
        inside = np.flatnonzero(shapely.contains(edge, areas))
        gaps = _room(areas[inside], edge, blocked)
        free, gaps = inside[gaps >= MARGIN], gaps[gaps >= MARGIN]
        standing_there = np.tile(np.eye(4), (len(free), 1, 1))
        standing_there[:, :2, :2] = turns[free].transpose(0, 2, 1)
        standing_there = standing_there @ upright
        standing_there[:, :2, 3] = spots[free] - middle @ turns[free]
        standing_there[:, 2, 3] = bottom - low[2]
        found += [
            PlacePose(pose, (x, y), number, gap, min(1.0, gap / radius))
            for pose, (x, y), gap in zip(
                standing_there, spots[free].tolist(), gaps.tolist(), strict=True
            )
        ]
    return sorted(found, key=lambda place: -place.clearance)


def _turns(angles: Floats) -> Floats:
    """(N, 2, 2) matrices that turn the rows on their left by angles."""
    cos, sin = np.cos(angles), np.sin(angles)
    turns: Floats = np.array([[cos, sin], [-sin, cos]]).transpose(2, 0, 1)
    return turns


def _grid(outline: Polygon, spacing: float) -> tuple[Floats, Floats]:
    """(N, 2) points in an outline, each with some headings, (N,)."""
    spots = spots_on(outline, spacing)
    which, turn = np.indices((len(spots), TURNS)).reshape(2, -1)
    return spots[which], np.asarray(2 * np.pi / TURNS * turn, np.float64)


def spots_on(outline: Polygon, spacing: float) -> Floats:
    """(N, 2) points in an outline, metres apart."""
    x0, y0, x1, y1 = outline.bounds
    x, y = np.meshgrid(
        np.arange(x0 + spacing / 2, x1, spacing), np.arange(y0 + spacing / 2, y1, spacing)
    )
    spots = np.column_stack([x.ravel(), y.ravel()])
    inside: Floats = spots[shapely.contains_xy(outline, spots)]
    return inside


def covered(
    spots: Sequence[PlacePose], surfaces: Sequence[LevelPatch], support: Floats
) -> frozenset[PlacePose]:
    """The spots below other parts, such as a board, of their support (F, 3, 3), metres."""
    found: set[PlacePose] = set()
    for number in {spot.surface for spot in spots}:
        here = [spot for spot in spots if spot.surface == number]
        above = support[..., 2].min(axis=1) > surfaces[number].height + ABOVE
        roof = shapely.union_all(_outlines(support[above][..., :2]))
        below = shapely.intersects_xy(roof, [spot.spot for spot in here])
        found.update(spot for spot, is_below in zip(here, below, strict=True) if is_below)
    return frozenset(found)


def _outlines(triangles: Floats) -> NDArray[np.object_]:
    """(F,) outlines of (F, 3, 2) triangles; seen from above, a wall is a line."""
    owner = np.repeat(np.arange(len(triangles)), 3)
    points = shapely.points(triangles.reshape(-1, 2))
    return np.asarray(shapely.convex_hull(shapely.multipoints(points, indices=owner)))


def _room(areas: NDArray[np.object_], edge: Polygon, blocked: Geometry) -> Floats:
    """(N,) metres from each area to the edge of a surface or to the nearest obstacle."""
    room: Floats = shapely.distance(areas, edge.boundary)
    if not blocked.is_empty:
        hit = shapely.intersects(blocked, areas)
        room[hit] = 0
        room[~hit] = np.minimum(room[~hit], shapely.distance(areas[~hit], blocked))
    return room


def stability(vertices: Floats, upright: Floats) -> float:
    """How firmly vertices (N, 3) stand in a pose (4, 4), by the tilt of a fall, up to `FIRM`."""
    standing = vertices @ upright[:3, :3].T
    centre = solid_hull(standing)[1]
    lowest = standing[:, 2].min()
    base = shapely.convex_hull(shapely.multipoints(standing[standing[:, 2] < lowest + BASE, :2]))
    point = shapely.Point(centre[:2])
    beside = shapely.distance(base.boundary, point) if base.contains(point) else 0.0
    tilt = np.arctan2(beside, centre[2] - lowest)
    return float(np.clip(tilt / FIRM, LEAST, 1.0))
