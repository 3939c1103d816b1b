"""A rough shape refined to the points: robust least squares on the faces that the points show."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import semmap_native
from semmap.perception.plane import Plane
from semmap.perception.point_cloud import Floats, Surfels
from semmap.perception.shapes import Placed


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
