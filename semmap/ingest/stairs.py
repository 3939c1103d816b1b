"""Stairs and ramps by their treads: where a robot stands before and behind them."""

from __future__ import annotations

from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from semmap.geometry.pose import Pose
from semmap.ingest.openings import BEHAVIOURS
from semmap.ingest.world import ConnectorDetail, Entry

STEP, RUN = 0.3, 1.0
"""Metres of height: of the treads at an end of a way, at most, and of those that show its
direction."""

LEVEL = 0.9
"""The least vertical part of the normal of what one walks on."""

STANDING = 0.5
"""Metres before the first tread and behind the last at which a robot stands."""


def walked_corners(triangles: NDArray[np.float64], level: float = LEVEL) -> NDArray[np.float64]:
    """Return the corners (N, 3) of the triangles (M, 3, 3) whose upper side one walks on.

    `level` is the least vertical part of their normals.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    walked: NDArray[np.float64] = triangles[normals[:, 2] > level * np.maximum(length, 1e-9)]
    return walked.reshape(-1, 3)


def way_ends(walked: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where a robot stands before the lower and behind the upper end of a way, (2, 3).

    `walked` are the corners (N, 3) of its treads, metres; z is that of the end's treads.
    """
    return np.array([_end(walked, 1.0), _end(walked, -1.0)])


def _end(walked: NDArray[np.float64], up: float) -> NDArray[np.float64]:
    height = up * walked[:, 2] - (up * walked[:, 2]).min()
    step = min(STEP, height.max() / 2)
    end, next_ = walked[height <= step], walked[(height > step) & (height <= step + RUN)]
    middle = _middle(end)
    away = middle - _middle(next_ if len(next_) else walked)
    away[2] = 0.0
    away /= max(float(np.linalg.norm(away)), 1e-9)
    edge = float(((end - middle) @ away).max())
    stands: NDArray[np.float64] = middle + (edge + STANDING) * away
    return stands


def _middle(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """The middle of the ground below corners, however many lie at a side; z is their mean."""
    ground = shapely.MultiPoint(corners[:, :2]).convex_hull.centroid
    return np.array([ground.x, ground.y, corners[:, 2].mean()])


def way_entry(
    name: str,
    type_: Literal["stairs", "ramp"],
    ends: NDArray[np.float64],
    places: tuple[str, str],
    floors: tuple[float, float],
) -> Entry:
    """Return the connector of a way between two places; `floors` are the z of theirs, metres.

    `ends` (2, 3) are as of `way_ends`; the entry's pose is in the frame of the map.
    """
    (ax, ay), (bx, by) = ends[:, :2].tolist()
    half, yaw = float(np.hypot(bx - ax, by - ay)) / 2, float(np.arctan2(by - ay, bx - ax))
    pose = Pose.planar((ax + bx) / 2, (ay + by) / 2, yaw, floors[0])
    entry = Entry(name, "connector", type_, pose=pose)
    entry.detail = ConnectorDetail(
        places,
        (Pose.planar(-half, 0.0), Pose.planar(half, 0.0, np.pi, floors[1] - floors[0])),
        type=type_,
        behaviour=BEHAVIOURS[type_],
    )
    return entry
