"""The shapes that can be fitted, their parameters, and their refinement.

A fit works on *bounds*, one number a face, because a view may show one end of a shape and not the
other:

========  ==========================================
sphere    radius
cylinder  radius, low z, high z
cuboid    low x, low y, low z, high x, high y, high z
cone      slope (radius / height), low z, z of the tip
========  ==========================================
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import semmap_native
from semmap.perception.plane import Plane
from semmap.perception.point_cloud import Floats, Surfels

SHAPES: dict[str, tuple[str, ...]] = {
    "sphere": ("radius",),
    "cylinder": ("radius", "height"),
    "cone": ("radius", "height"),
    "cuboid": ("x", "y", "z"),
}
"""Parameters of the shapes, metres."""


class Placed(NamedTuple):
    """A shape in the frame of the points."""

    kind: str  # a key of `SHAPES`
    rotation: Floats  # (3, 3), its columns are the axes of the shape
    origin: Floats  # (3,) of the frame of the shape, metres
    bounds: Floats  # as the table above, in the frame of the shape, metres

    def distances(self, points: Floats) -> Floats:
        """Return the largest of the distances of points (n, 3) to the unbounded faces, (n,) metres.

        They are positive outside; inside, their size is the distance to the surface.
        """
        return semmap_native.shape_distances(*self, points)


def size_of(kind: str, bounds: Floats) -> Floats:
    """Return the parameters of `SHAPES` for bounds."""
    if kind == "sphere":
        return bounds
    if kind == "cuboid":
        return bounds[3:] - bounds[:3]
    height = bounds[2] - bounds[1]
    return np.array([bounds[0] * (height if kind == "cone" else 1), height])


class Fit(NamedTuple):
    """A refined shape."""

    placed: Placed  # the shape
    seen: NDArray[np.bool_]  # (faces,) bool, which faces have points
    # standard deviations of the sizes, metres; infinite for those that are not seen
    deviation: Floats

    def local(self, points: Floats) -> Floats:
        """Return points (n, 3) in the frame of the shape."""
        return np.asarray((points - self.placed.origin) @ self.placed.rotation)


def refined(
    shape: Placed,
    cloud: Surfels,
    whole: Floats,
    noise: float,
    table: Plane | None,
    turns: int = 2,
) -> Fit | None:
    """Return a rough shape fitted to the points, or None if they show none of its faces.

    All points, `whole` (n, 3), tell where edges are; `noise` is their standard deviation, metres.
    The faces that are seen are determined so many `turns`; with 1, the fit is a rough one.
    """
    fit = semmap_native.fit_shape(
        *shape, cloud.points, cloud.normals, whole, cloud.spacing, noise, table, turns
    )
    if fit is None:
        return None
    rotation, origin, bounds, seen, deviation = fit
    return Fit(Placed(shape.kind, rotation, origin, bounds), seen, deviation)
