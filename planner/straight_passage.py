"""Where a robot drives straight through an opening, measured on shapes and not on cells.

Cells are conservative: they close gaps that are up to three of them wider than the robot. Doorways
are such gaps.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from navgrid.costmap import Costmap
from navgrid.slabs import flat_triangles
from planner.robot_class import SAME
from planner.topology import PlaceConnector
from semmap.geometry.pose import Pose
from semmap.query.storey_scene import SceneEntity

Floats = NDArray[np.float64]
Interval = tuple[float, float]


def free_offsets(costmap: Costmap, door: PlaceConnector) -> list[Interval]:
    """Return where a robot drives straight through an opening, from one approach pose to the other.

    These are the intervals of its origin along the opening, metres from the middle to the left of
    the way from the first place; the nearest to the middle comes first. There, all parts of the
    robot are between the posts, and meet no shape at their heights.
    """
    along, half = door.way.length / 2, door.leaf().length / 2
    (a, b), middle = door.poses, door.way.interpolate(0.5, normalized=True)
    frame = Pose.planar(middle.x, middle.y, math.atan2(b.y - a.y, b.x - a.x))
    floors = [f.floor for f in costmap.scene.floors if f.name in (door.name, *door.places)]
    floors = floors or [costmap.scene.elevation]
    ground, taken = opening(door), [np.zeros((0, 2))]
    for number, part in enumerate(costmap.parts):
        right, left = float(part.footprint[:, 1].min()), float(part.footprint[:, 1].max())
        taken.append(np.array([(-math.inf, -half - right), (half - left, math.inf)]))
        low, high = costmap.intervals[number]
        heights = min(floors) + low, max(floors) + high
        for padding, triangles in _obstacles(costmap, number, heights, ground):
            local = frame.inverse().apply(triangles.reshape(-1, 3)).reshape(-1, 3, 3)
            edge = np.array([along + padding, half + padding])
            within = np.array([[*-edge, heights[0]], [*edge, heights[1]]])
            taken.append(_extents(local, within) - [left + padding, right - padding])
    between = np.concatenate(taken)
    between = between[np.argsort(between[:, 0])]
    ends = np.maximum.accumulate(between[:-1, 1]) - SAME
    starts = between[1:, 0] + SAME
    free = np.stack([ends, starts], axis=1)[starts >= ends].tolist()
    return sorted(map(tuple, free), key=lambda f: max(f[0], -f[1], 0.0))


def opening(door: PlaceConnector) -> shapely.Polygon:
    """The ground between the posts of an opening, from one approach pose to the other."""
    return door.way.buffer(door.leaf().length / 2, cap_style="flat")


def _obstacles(
    costmap: Costmap, number: int, heights: Interval, ground: shapely.Polygon
) -> Iterator[tuple[float, Floats]]:
    """The padding and the (F, 3, 3) triangles of a part's obstacles near some ground."""
    members = costmap.obstacles.members.layers
    for layer in costmap.layers:
        bounds = ground.buffer(layer.padding + SAME, join_style="mitre").bounds
        low = np.array([*bounds[:2], heights[0] - SAME])
        high = np.array([*bounds[2:], heights[1] + SAME])
        found = [
            _near(_triangles(entity, heights), low, high)
            for entity in members.get(layer.name, {}).values()
            if (b := entity.bounds) is not None
            and (b[:2] <= high[:2]).all()
            and (b[2:] >= low[:2]).all()
        ]
        if layer.name not in members:
            grid, cells = costmap.grid, np.argwhere(costmap.occupied[layer.name][number])
            corners = np.array(grid.origin) + cells[:, ::-1] * grid.resolution
            found.append(_squares(corners, grid.resolution, sum(heights) / 2))
        yield layer.padding, np.concatenate([np.zeros((0, 3, 3)), *found])


def _near(triangles: Floats, low: Floats, high: Floats) -> Floats:
    """Those of (F, 3, 3) triangles whose boxes meet one."""
    for axis in range(3):
        a, b, c = triangles[:, :, axis].T
        far = np.minimum(np.minimum(a, b), c) > high[axis]
        far |= np.maximum(np.maximum(a, b), c) < low[axis]
        triangles = triangles[~far]
    return triangles


def _triangles(entity: SceneEntity, heights: Interval) -> Floats:
    """The (F, 3, 3) faces of an entity; of a region and of voxels, flat ones at the heights."""
    middle = sum(heights) / 2
    if entity.kind == "region":
        flat = flat_triangles(entity.footprint or shapely.Polygon())
        return np.asarray(flat + np.array([0, 0, middle]))
    voxels = entity.voxels
    if voxels is None or not len(voxels):
        return entity.triangles
    z = voxels.indices[:, 2] * voxels.size
    columns = voxels.indices[(z <= heights[1]) & (z + voxels.size >= heights[0]), :2]
    squares = _squares(np.asarray(columns * voxels.size, np.float64), voxels.size, middle)
    return np.concatenate([entity.triangles, squares])


def _squares(corners: Floats, size: float, z: float) -> Floats:
    """The (2 N, 3, 3) halves of level squares with these lower left corners (N, 2)."""
    halves = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]]) * size
    flat = (corners[:, None, None] + halves).reshape(-1, 3, 2)
    return np.pad(flat, ((0, 0), (0, 0), (0, 1)), constant_values=z)


def _extents(triangles: Floats, within: Floats) -> Floats:
    """The (N, 2) extents in y of the parts of triangles within a box (2, 3), unbounded in y.

    Those of which none is in the box are left out.
    """
    within = within + np.array([[-SAME], [SAME]])
    triangles = _near(triangles, *within)
    for axis in (0, 2):
        triangles = _cut(triangles, axis, within[0, axis], 1.0)
        triangles = _cut(triangles, axis, within[1, axis], -1.0)
    y = triangles[:, :, 1]
    return np.stack([y.min(axis=1), y.max(axis=1)], axis=1)


def _cut(triangles: Floats, axis: int, end: float, sign: float) -> Floats:
    """The parts of (F, 3, 3) triangles above an end of an axis; below it for a sign of -1."""
    depth = sign * (triangles[:, :, axis] - end)
    inside = depth >= 0
    count = inside.sum(axis=1)
    parts = [triangles[count == 3]]
    for many in (1, 2):
        odd = np.argmax(inside[count == many] == (many == 1), axis=1)  # alone on its side
        order = (odd[:, None] + np.arange(3)) % 3
        at = np.take_along_axis(triangles[count == many], order[:, :, None], 1)
        a, b, c = np.take_along_axis(depth[count == many], order, 1).T
        one = at[:, 0] + (at[:, 1] - at[:, 0]) * (a / (a - b))[:, None]
        two = at[:, 0] + (at[:, 2] - at[:, 0]) * (a / (a - c))[:, None]
        if many == 1:
            parts.append(np.stack([at[:, 0], one, two], axis=1))
        else:
            parts.append(np.stack([one, at[:, 1], at[:, 2]], axis=1))
            parts.append(np.stack([one, at[:, 2], two], axis=1))
    return np.concatenate(parts)
