"""The plane that most points of a cloud are on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from semmap.perception.point_cloud import Floats, PerceptionError

TRIES = 300
SCORED = 2000


class Plane(NamedTuple):
    """The points x with ``normal @ x == offset``."""

    normal: Floats  # (3,) unit vector, upwards
    offset: float  # float, metres

    def height(self, points: Floats) -> Floats:
        """Return how far points (n, 3) are above the plane, metres."""
        return np.asarray(points @ self.normal - self.offset)


def unit_vector(given: ArrayLike, what: str) -> Floats:
    """Return a vector of three numbers at length 1; PerceptionError for others and for 0."""
    vector = np.asarray(given, np.float64)
    length = float(np.linalg.norm(vector)) if vector.shape == (3,) else 0.0
    if not np.isfinite(length) or length < 1e-9:
        raise PerceptionError(f"{what} is {given!r}: give three finite numbers that are not all 0")
    return vector / length


def find_plane(
    points: Floats,
    *,
    up: ArrayLike = (0, 0, 1),
    tilt: float = np.radians(15),
    tolerance: float = 0.01,
    seed: int = 0,
) -> Plane:
    """Return the level plane that most points (n, 3) are on: RANSAC, then least squares.

    `up` is in the frame of the points; `tilt` is the largest angle of the normal to it, radians;
    points within `tolerance` metres are on the plane. Raises PerceptionError: no level plane has a
    tenth of the points.
    """
    upward = unit_vector(up, "up")
    random = np.random.default_rng(seed)
    sample = points[random.permutation(len(points))[:SCORED]]
    a, b, c = points[random.integers(0, len(points), (TRIES, 3))].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
    normal *= np.where(normal @ upward < 0, -1, 1)[:, None]
    near = np.abs(sample @ normal.T - np.einsum("hi,hi->h", a, normal)) < tolerance
    count = np.where(normal @ upward > np.cos(tilt), near.sum(axis=0), 0)
    best = int(count.argmax())
    found = Plane(normal[best], float(a[best] @ normal[best]))
    for width in (tolerance, tolerance / 2):
        on = points[np.abs(found.height(points)) < width]
        if len(on) < max(3, 0.1 * len(points)):
            break
        middle = on.mean(axis=0)
        fitted = np.linalg.eigh((on - middle).T @ (on - middle))[1][:, 0]
        fitted *= 1 if fitted @ upward > 0 else -1
        found = Plane(fitted, float(middle @ fitted))
    share = float((np.abs(found.height(points)) < tolerance).mean())
    if count[best] == 0 or share < 0.1 or found.normal @ upward < np.cos(tilt):
        raise PerceptionError(
            f"no level plane has a tenth of the {len(points)} points: check that the table is in "
            "view, and that `up` is upwards in the frame of the cloud"
        )
    return found
