"""Viewpoints: where the robot's base stands to see the places at which an object may be.

Candidates are free positions with some headings each. Those are taken that together show most of
the belief, one after another: the next is the one that adds most (a cover within 63 % of the best).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.ndimage import binary_dilation
from scipy.sparse import csr_array

from planner.search.line_of_sight import LineOfSight
from planner.storey_costmaps import StoreyCostmaps
from semmap.arrays import Floats, Mask
from semmap.belief.views import camera_at
from semmap.draw.depth_camera import DepthCamera
from semmap.geometry.pose import Pose

HEADINGS = 8  # headings that are tried at each position

BODY = (0.25, 0.05, 1.2)
"""Radius, and lower and upper end above the floor, of a robot whose shape is unknown, metres."""


@dataclass(frozen=True)
class Sight:
    """The camera of a robot: above its base, looking ahead and down; its picture is 4 : 3.

    It recognises objects between `nearest` and `furthest`, metres.
    """

    height: float = 1.2  # above the floor, metres
    pitch: float = 0.26  # downwards from the horizon, radians
    field_of_view: float = 1.2  # horizontal opening angle, radians
    nearest: float = 0.3
    furthest: float = 3.5

    def __post_init__(self) -> None:
        if not 0 < self.height < math.inf:
            raise ValueError(
                f"the camera is {self.height} m above the floor; give a height above 0"
            )
        if not 0 <= self.nearest < self.furthest < math.inf:
            raise ValueError(
                f"the camera sees from {self.nearest} to {self.furthest} m; give the nearer end "
                "first"
            )

    def eye(self, base: Pose) -> Floats:
        """(3,) where the camera is, for a base pose in the map's frame."""
        return np.array([base.x, base.y, base.z + self.height])

    def camera(self, base: Pose, size: tuple[int, int] = (240, 180)) -> DepthCamera:
        """The camera in the map's frame, for a base pose."""
        return camera_at(
            self.eye(base),
            base.yaw,
            self.pitch,
            field_of_view=self.field_of_view,
            size=size,
            nearest=self.nearest,
        )

    def frames(self, eye: Floats, yaws: Floats, points: Floats) -> Mask:
        """(H, N) which points (N, 3) are in the picture of each yaw (H,), if nothing hides them."""
        x, y, z = (points - eye).T
        cos, sin = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
        level = x * cos + y * sin
        right = x * sin - y * cos
        ahead = level * math.cos(self.pitch) - z * math.sin(self.pitch)
        down = -level * math.sin(self.pitch) - z * math.cos(self.pitch)
        half = math.tan(self.field_of_view / 2)
        mask: Mask = (
            (abs(right) <= half * ahead)
            & (abs(down) <= 0.75 * half * ahead)
            & (ahead > self.nearest)
            & (x * x + y * y + z * z <= self.furthest**2)
        )
        return mask


def free_positions(
    place: str,
    floor: float,
    outline: shapely.Geometry,
    space: LineOfSight,
    costmaps: StoreyCostmaps | None,
    step: float = 0.7,
) -> Floats:
    """(N, 2) positions of the base in a place, about a step apart, the clearest ones, metres.

    `space` is the free space, for a robot without a costmap; `floor` the z of the floor.
    """
    if costmaps is not None:
        ground = costmaps.ground(place)
        if ground is None:
            return np.empty((0, 2))
        cells, points = ground.free()
        price = ground.costs[tuple(cells.T)].astype(float)
        inside = shapely.contains_xy(outline, points)  # the costs reach into doorways
        points, price = points[inside], price[inside]
    else:
        points, price = _free_without_costmap(floor, outline, space)
    if not len(points):
        return np.empty((0, 2))
    order = np.lexsort((*points.T, price))
    block = np.floor(points[order] / step).astype(int)
    _, first = np.unique(block, axis=0, return_index=True)
    chosen: Floats = points[order][np.sort(first)]
    return chosen


def _free_without_costmap(
    floor: float, outline: shapely.Geometry, space: LineOfSight
) -> tuple[Floats, Floats]:
    radius, low, high = BODY
    size = space.size
    x, y = (np.arange(outline.bounds[k], outline.bounds[k + 2] + size, size) for k in (0, 1))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    blocked = ~space.free_columns(x, y, floor + low + size, floor + high)
    reach = math.ceil(radius / size)
    disc = np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) <= reach
    free = ~binary_dilation(blocked, disc)
    points = grid[free]
    points = points[shapely.contains_xy(outline, points)]
    return points, np.zeros(len(points))


def views_from(
    positions: Floats, floor: float, points: Floats, space: LineOfSight, sight: Sight
) -> tuple[list[Pose], Mask]:
    """The base poses at positions (C, 2), and which points (N, 3) each sees, (C * headings, N)."""
    poses: list[Pose] = []
    seen: list[Mask] = []
    yaws = 2 * math.pi * np.arange(HEADINGS) / HEADINGS - math.pi
    for x, y in positions:
        eye = np.array([x, y, floor + sight.height])
        near = np.flatnonzero(np.linalg.norm(points - eye, axis=1) <= sight.furthest)
        clear = near[space.sees(eye, points[near])] if space.is_free(eye) else near[:0]
        for yaw, framed in zip(yaws, sight.frames(eye, yaws, points[clear]), strict=True):
            if framed.any():
                mask = np.zeros(len(points), np.bool_)
                mask[clear] = framed
                poses.append(Pose.planar(float(x), float(y), float(yaw), floor))
                seen.append(mask)
    return poses, np.array(seen, np.bool_).reshape(-1, len(points))


def choose_views(
    seen: Mask, weights: Floats, seconds: Floats, most: int = 30, least: float = 0.002
) -> list[int]:
    """The numbers of the views that together show most.

    `seen` (C, N) says which points each view shows, `weights` (N,) the belief in each point. Of two
    views that add the same, the one of fewer `seconds` (C,) from the robot is taken; infinite ones
    are left out. One that adds less than the share `least` of what can be seen is the last.
    """
    left = weights.copy()
    shown = csr_array(seen, dtype=np.float64)
    reachable = np.isfinite(seconds)
    whole = float(weights[seen[reachable].any(axis=0)].sum()) if reachable.any() else 0.0
    chosen: list[int] = []
    while len(chosen) < most and whole > 0:
        gain = np.where(reachable, shown @ left, -1.0)
        best = np.flatnonzero(gain >= gain.max() * (1 - 1e-9))
        view = int(best[np.argmin(seconds[best])])
        if gain[view] <= least * whole:
            break
        chosen.append(view)
        left[seen[view]] = 0.0
    return chosen
