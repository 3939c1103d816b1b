"""Which part of each place a camera sees, whether or not it shows the object there."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semmap.belief.error import BeliefError
from semmap.belief.places import BeliefPlace, sample_points
from semmap.draw.depth_camera import DepthCamera

DEPTH_TOLERANCE = 0.02
"""Metres by which a surface may be nearer than a point that it carries."""


def camera_at(
    eye: ArrayLike,
    yaw: float,
    pitch: float = 0.0,
    *,
    field_of_view: float = 1.05,
    size: tuple[int, int] = (320, 240),
    nearest: float = 0.1,
) -> DepthCamera:
    """Return an upright camera at (3,) metres in the map's frame.

    `yaw` is its heading from +x, `pitch` downwards from the horizon, `field_of_view` the horizontal
    opening angle, radians; `size` is (width, height), pixels. `BeliefError` out of range.
    """
    place = np.asarray(eye, float)
    if place.shape != (3,) or not np.isfinite([*place, yaw, pitch]).all():
        raise BeliefError(f"the view is from {place}, {yaw}, {pitch}: give finite numbers")
    if not 0 < field_of_view < math.pi or abs(pitch) > math.pi / 2 or min(size) < 1:
        raise BeliefError(
            f"the view opens {field_of_view} rad and looks {pitch} rad down: give an opening "
            "between 0 and pi, and at most pi/2"
        )
    cos, sin = math.cos(yaw), math.sin(yaw)
    ahead = np.array([cos * math.cos(pitch), sin * math.cos(pitch), -math.sin(pitch)])
    right = np.array([sin, -cos, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(ahead, right), ahead])
    pose[:3, 3] = place
    focal = size[0] / 2 / math.tan(field_of_view / 2)
    intrinsics = (focal, focal, (size[0] - 1) / 2, (size[1] - 1) / 2)
    return DepthCamera(size, intrinsics, pose, nearest)


def visible_points(
    camera: DepthCamera,
    points: NDArray[np.float64],
    depths: NDArray[np.float32],
    furthest: float = math.inf,
) -> NDArray[np.bool_]:
    """Return (n,) which points (n, 3), metres in the map's frame, no surface hides.

    `depths` (height, width) is the camera's image of all surfaces, NaN where there is none;
    `furthest` is the range of the sensor, metres.
    """
    width, height = camera.size
    offset = points - camera.pose[:3, 3]
    ahead = offset @ camera.pose[:3, 2]
    seen = (ahead > camera.nearest) & (np.linalg.norm(offset, axis=1) <= furthest)
    image = np.zeros((len(points), 3))
    image[seen] = camera.project(points[seen])
    column, row = np.floor(image[:, 0]).astype(int), np.floor(image[:, 1]).astype(int)
    seen &= (column >= 0) & (column < width) & (row >= 0) & (row < height)
    surface = depths[row[seen], column[seen]]
    seen[seen] = np.isnan(surface) | (surface >= ahead[seen] - DEPTH_TOLERANCE)
    return np.asarray(seen)


def visible_shares(
    places: Iterable[BeliefPlace],
    camera: DepthCamera,
    depths: NDArray[np.float32],
    *,
    furthest: float = math.inf,
    step: float = 0.05,
    height: float = 0.1,
    shut: Collection[str] = (),
    opened: Collection[str] = (),
) -> dict[str, float]:
    """Return the share of each place that a camera sees, in (0, 1], where it sees any of it.

    Points over the surfaces of a place, at half the height of an object, are visible if a ray from
    the camera reaches them. `depths` (height, width) is its image of all that hides, without the
    object that is looked for; `furthest`, `step` (between points) and `height` (of it) are metres.
    What is within places that are `shut` is hidden, within those that the robot has `opened` seen.
    """
    shares = {}
    for place in places:
        points = sample_points(place, step, height / 2)
        seen = visible_points(camera, points.at, depths, furthest)
        if place.name in opened:
            seen |= points.within
        elif place.name in shut:
            seen &= ~points.within
        if seen.any():
            shares[place.name] = min(float(points.weight[seen].sum()), 1.0)
    return shares
