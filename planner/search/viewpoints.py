"""Viewpoints: where the robot stands, and how it holds its camera, to see where an object may be.

Candidates are free positions with some headings, heights and tilts of the camera each. Those are
taken that together show most of the belief, one after another: the next is the one that adds most
(a cover within 63 % of the best).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from planner.search.line_of_sight import LineOfSight
from planner.storey_costmaps import StoreyCostmaps
from semmap.arrays import Floats, Mask
from semmap.belief.views import camera_at
from semmap.draw.depth_camera import DepthCamera
from semmap.geometry.pose import Pose

HEADINGS = 8  # directions in which the camera looks at each position

BODY = (0.25, 0.05, 1.2)
"""Radius, and lower and upper end above the floor, of a robot whose shape is unknown, metres."""


class Aim(NamedTuple):
    """How a robot holds its camera."""

    height: float  # of the camera above the floor, metres
    pitch: float  # downwards from the horizon, radians
    pan: float = 0.0  # of the head to the left of the base's heading, radians


@dataclass(frozen=True)
class Sight:
    """The camera of a robot, above its base; its picture is 4 : 3.

    It can be held at each of the `heights`, tilted to each of the `pitches`, and turned by up to
    `pan` to either side; a robot whose head does not turn turns its base. It recognises objects
    between `nearest` and `furthest`, metres.
    """

    heights: tuple[float, ...] = (1.2,)  # above the floor, metres
    pitches: tuple[float, ...] = (0.26, 0.8)  # downwards from the horizon, radians
    pan: float = 0.0  # radians
    field_of_view: float = 1.2  # horizontal opening angle, radians
    nearest: float = 0.3
    furthest: float = 3.5
    lift: float = 0.07  # of its height, metres a second

    def __post_init__(self) -> None:
        for height in self.heights or (math.nan,):
            if not 0 < height < math.inf:
                raise ValueError(f"the camera is {height} m above the floor; give a height above 0")
        for pitch in self.pitches or (math.nan,):
            if not abs(pitch) < math.pi / 2:
                raise ValueError(
                    f"the camera looks {pitch} rad down; give an angle between -pi/2 and pi/2"
                )
        if not (0 <= self.pan < math.inf and 0 < self.lift < math.inf):
            raise ValueError(
                f"the head turns by {self.pan} rad and moves up {self.lift} m/s; give an angle of "
                "0 or more and a speed above 0"
            )
        if not 0 <= self.nearest < self.furthest < math.inf:
            raise ValueError(
                f"the camera sees from {self.nearest} to {self.furthest} m; give the nearer end "
                "first"
            )

    @property
    def rest(self) -> Aim:
        """Straight ahead, at the lowest height, nearest to level."""
        return Aim(min(self.heights), min(self.pitches, key=abs))

    def aims(self) -> list[tuple[float, Aim]]:
        """The headings of the base with the aims of its camera, which look in all directions.

        A head that turns needs fewer headings of the base.
        """
        step = math.tau / HEADINGS
        aside = min(int(self.pan / step + 1e-9), HEADINGS // 2)
        found = []
        for number in range(HEADINGS):
            base = number - number % (2 * aside + 1) + aside
            yaw, pan = base * step - math.pi, (number - base) * step
            for height, pitch in itertools.product(self.heights, self.pitches):
                found.append((yaw, Aim(height, pitch, pan)))
        return found

    def eye(self, base: Pose, aim: Aim) -> Floats:
        """(3,) where the camera is, for a base pose in the map's frame."""
        return np.array([base.x, base.y, base.z + aim.height])

    def pose(self, base: Pose, aim: Aim) -> Pose:
        """The pose of the camera in the map's frame: x ahead, z up."""
        turned = Rotation.from_euler("ZY", (base.yaw + aim.pan, aim.pitch)).as_quat()
        return Pose(base.x, base.y, base.z + aim.height, *map(float, turned))

    def camera(self, pose: Pose, size: tuple[int, int] = (240, 180)) -> DepthCamera:
        """The camera at a pose in the map's frame, as of `pose`."""
        ahead = pose.apply([[1.0, 0.0, 0.0]])[0] - pose.apply([[0.0, 0.0, 0.0]])[0]
        return camera_at(
            pose[:3],
            math.atan2(ahead[1], ahead[0]),
            -math.asin(min(max(float(ahead[2]), -1.0), 1.0)),
            field_of_view=self.field_of_view,
            size=size,
            nearest=self.nearest,
        )

    def frames(self, offsets: Floats, yaw: float, pitch: float) -> Mask:
        """(N,) which points are in the picture, at offsets (N, 3) from the eye, unless hidden."""
        x, y, z = offsets.T
        cos, sin = math.cos(yaw), math.sin(yaw)
        level = x * cos + y * sin
        right = x * sin - y * cos
        ahead = level * math.cos(pitch) - z * math.sin(pitch)
        down = -level * math.sin(pitch) - z * math.cos(pitch)
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
) -> tuple[list[tuple[Pose, Aim]], list[NDArray[np.intp]]]:
    """The base poses at positions (C, 2) with aims, and the numbers of points (N, 3) in each view.

    Views that show nothing are left out.
    """
    views: list[tuple[Pose, Aim]] = []
    seen: list[NDArray[np.intp]] = []
    each = sight.aims()
    for x, y in positions.tolist():
        clear = {}
        for height in sight.heights:
            eye = np.array([x, y, floor + height])
            near = np.flatnonzero(np.linalg.norm(points - eye, axis=1) <= sight.furthest)
            free = len(near) > 0 and space.is_free(eye)
            clear[height] = near[space.sees(eye, points[near])] if free else near[:0]
        for yaw, aim in each:
            there = clear[aim.height]
            offsets = points[there] - (x, y, floor + aim.height)
            shown = there[sight.frames(offsets, yaw + aim.pan, aim.pitch)]
            if len(shown):
                views.append((Pose.planar(x, y, yaw, floor), aim))
                seen.append(shown)
    return views, seen


def choose_views(
    seen: csr_array, weights: Floats, seconds: Floats, most: int, least: float = 0.002
) -> list[int]:
    """The numbers of the views that together show most.

    `seen` (C, N) has a 1 where a view shows a point, `weights` (N,) the belief in each point. Of
    two views that add the same, the one of fewer `seconds` (C,) from the robot is taken; infinite
    ones are left out. One that adds less than the share `least` of what can be seen is the last.
    """
    left = weights.copy()
    reachable = np.isfinite(seconds)
    by_point = seen.tocsc()
    gain = np.where(reachable, seen @ left, -1.0)
    whole = float(weights[seen[reachable].sum(axis=0) > 0].sum()) if reachable.any() else 0.0
    chosen: list[int] = []
    while len(chosen) < most and whole > 0:
        best = np.flatnonzero(gain >= gain.max() - 1e-9 * whole)
        view = int(best[np.argmin(seconds[best])])
        if gain[view] <= least * whole:
            break
        chosen.append(view)
        shown = seen.indices[seen.indptr[view] : seen.indptr[view + 1]]
        gain -= by_point[:, shown] @ left[shown]
        left[shown] = 0.0
    return chosen
