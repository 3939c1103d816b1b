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
from navgrid.slabs import flat_triangles, mesh_of
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
    taken: list[Interval] = []
    for number, part in enumerate(costmap.parts):
        right, left = float(part.footprint[:, 1].min()), float(part.footprint[:, 1].max())
        taken += [(-math.inf, -half - right), (half - left, math.inf)]
        low, high = costmap.intervals[number]
        heights = min(floors) + low, max(floors) + high
        for padding, triangles in _obstacles(costmap, number, heights, frame, along + half):
            local = frame.inverse().apply(triangles.reshape(-1, 3)).reshape(-1, 3, 3)
            for one, two in _extents(local, along + padding, heights):
                taken.append((one - left - padding, two - right + padding))
    free, start = [], math.inf
    for one, two in sorted(taken):
        if one + SAME >= start - SAME:
            free.append((start - SAME, one + SAME))
        start = two if math.isinf(start) else max(start, two)
    return sorted(free, key=lambda f: max(f[0], -f[1], 0.0))


def _obstacles(
    costmap: Costmap, number: int, heights: Interval, frame: Pose, reach: float
) -> Iterator[tuple[float, Floats]]:
    """The padding and the (F, 3, 3) triangles of each obstacle of a part near a frame's origin."""
    members = costmap.obstacles.members.layers
    for layer in costmap.layers:
        near = reach + layer.padding
        for entity in members.get(layer.name, {}).values():
            if (b := entity.bounds) is not None and (
                b[0] <= frame.x + near
                and frame.x - near <= b[2]
                and b[1] <= frame.y + near
                and frame.y - near <= b[3]
            ):
                yield layer.padding, _triangles(entity, heights)
        if layer.name not in members:
            grid, cells = costmap.grid, np.argwhere(costmap.occupied[layer.name][number])
            corners = np.array(grid.origin) + cells[:, ::-1] * grid.resolution
            yield layer.padding, _squares(corners, grid.resolution, sum(heights) / 2)


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


def _extents(triangles: Floats, along: float, heights: Interval) -> list[Interval]:
    """The extents in y of the parts of triangles within -along and along in x, and heights in z."""
    from trimesh.intersections import slice_faces_plane  # slow to load

    vertices, faces = mesh_of(triangles)
    for axis, sign, end in (
        (0, 1, -along),
        (0, -1, along),
        (2, 1, heights[0]),
        (2, -1, heights[1]),
    ):
        normal = sign * np.eye(3)[axis]
        vertices, faces, _ = slice_faces_plane(  # type: ignore[no-untyped-call]
            vertices, faces, normal, normal * (sign * end - SAME)
        )
    y = vertices[faces, 1]
    return [*zip(y.min(axis=1).tolist(), y.max(axis=1).tolist(), strict=True)] if len(faces) else []
