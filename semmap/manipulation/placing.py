"""Where an object can be put: spots on support surfaces that are large and free enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.affinity import rotate, translate

from semmap.geometry.surfaces import LevelPatch
from semmap.manipulation.error import ManipulationError

__all__ = ["Place", "place_candidates"]

Floats = NDArray[np.float64]

TURNS = 8
"""Headings that are tried at each spot."""

ABOVE = 0.003
"""Metres by which an object is released above the surface."""


@dataclass(frozen=True, eq=False)
class Place:
    """A pose of an object on a surface.

    Attributes
    ----------
    pose : (4, 4) of the model in the frame of the surfaces
    surface : number of the surface
    clearance : metres to the nearest edge or obstacle
    quality : 0 to 1; the clearance, at most one radius of the object, by that radius
    """

    pose: Floats
    surface: int
    clearance: float
    quality: float


def place_candidates(
    vertices: Floats,
    upright: Floats,
    surfaces: Sequence[LevelPatch],
    obstacles: Floats,
    *,
    margin: float = 0.01,
    spacing: float = 0.04,
) -> list[Place]:
    """Return poses at which an object stands free on a surface, the ones with most room first.

    Parameters
    ----------
    vertices : (N, 3) of the object, in the frame of its model
    upright : (4, 4)
        The pose in which it stands; its place and its heading are chosen here.
    surfaces : support surfaces (`semmap.geometry.surfaces`), in the frame of the obstacles
    obstacles : (F, 3, 3) triangles of all else, metres
    margin : least distance to edges and obstacles, metres
    spacing : metres between spots that are tried

    Raises
    ------
    ManipulationError
        A number is not above 0, or the object has no extent.
    """
    if not (margin >= 0 and spacing > 0):
        raise ManipulationError(
            f"margin is {margin:g} and spacing {spacing:g}: give at least 0, and above 0"
        )
    standing = vertices @ upright[:3, :3].T
    low, high = standing.min(axis=0), standing.max(axis=0)
    hull = shapely.convex_hull(shapely.multipoints(standing[:, :2]))
    if not isinstance(hull, Polygon) or hull.area == 0:
        raise ManipulationError("object: seen from above it has no area; give the mesh of a solid")
    middle = np.array(hull.centroid.coords[0])
    base = translate(hull, *-middle)
    radius = float(np.linalg.norm(shapely.get_coordinates(base), axis=1).max())
    lowest, highest = obstacles[..., 2].min(axis=1), obstacles[..., 2].max(axis=1)
    found = []
    for number, surface in enumerate(surfaces):
        if surface.area < base.area:
            continue
        bottom, top = surface.height + ABOVE, surface.height + ABOVE + high[2] - low[2] + margin
        x0, y0, x1, y1 = surface.outline.bounds
        flat = obstacles[..., :2]
        near = (highest > bottom) & (lowest < top)
        near &= np.all(flat.max(axis=1) > (x0, y0), axis=1)
        near &= np.all(flat.min(axis=1) < (x1, y1), axis=1)
        # Seen from above a wall is a line, which has a distance, too.
        blocked = shapely.union_all(
            [shapely.convex_hull(shapely.multipoints(corners)) for corners in flat[near]]
        )
        free = surface.outline.difference(blocked.buffer(margin)) if near.any() else surface.outline
        x, y = np.meshgrid(
            np.arange(x0 + spacing / 2, x1, spacing), np.arange(y0 + spacing / 2, y1, spacing)
        )
        spots = np.column_stack([x.ravel(), y.ravel()])
        room = shapely.distance(shapely.points(spots), free.boundary)
        inside = shapely.contains_xy(free, spots)
        for spot, clear in zip(spots[inside], room[inside], strict=True):
            turns = range(1 if clear >= radius + margin else TURNS)
            for turn in turns:
                angle = 2 * np.pi * turn / TURNS
                area = translate(rotate(base, angle, origin=(0, 0), use_radians=True), *spot)
                gap = float(shapely.distance(area, free.boundary)) if free.contains(area) else -1.0
                if gap >= margin:
                    pose = _turned(upright, angle, middle, spot, bottom - low[2])
                    found.append(Place(pose, number, gap, min(1.0, gap / radius)))
    return sorted(found, key=lambda place: -place.clearance)


def _turned(upright: Floats, angle: float, middle: Floats, spot: Floats, height: float) -> Floats:
    """The upright pose, turned about the vertical axis through its middle and moved to a spot."""
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    rotation = np.eye(4)
    rotation[:3, :3] = upright[:3, :3]
    pose = turn @ rotation
    pose[:2, 3] = spot - turn[:2, :2] @ middle
    pose[2, 3] = height
    return pose
