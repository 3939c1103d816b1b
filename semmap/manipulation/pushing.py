"""Pushes of an object along free directions of its surface (Tosello et al., section III-A)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon
from shapely.ops import nearest_points

from semmap.arrays import Floats
from semmap.manipulation.collision import GAP, Obstacles, convex_body, swept_link
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper import Gripper

SAFETY = 0.05
"""Metres between pre-push and push."""

TIP = 0.01
"""Metres by which pads end in front of their middle."""

DIRECTIONS = 16
"""Directions of pushes."""


@dataclass(frozen=True, eq=False)
class Push:
    """A push of an object by the closed gripper, straight and level.

    `pose` and `end` (4, 4) are the grasp frame where the fingers touch the object and where the
    push ends, `pre_push` that before the approach, `posture` that of the closed fingers. `quality`
    is how squarely the finger meets the object, and how near to the line through its middle, 0..1.
    """

    pose: Floats
    end: Floats
    pre_push: Floats
    posture: dict[str, float]
    quality: float

    @classmethod
    def of_row(cls, row: dict[str, Any]) -> Push:
        """The push of a row of `find_pushes`, in the map's frame."""
        before = row["pre_pose"] or row["pose"]
        poses = (row["pose"].matrix, row["end"].matrix, before.matrix)
        return cls(*poses, row["posture"], row["expected"])

    @property
    def way(self) -> Floats:
        """The way of the object, (3,) metres."""
        way: Floats = (self.end - self.pose)[:3, 3]
        return way

    @property
    def distance(self) -> float:
        """The length of the way, metres."""
        return float(np.linalg.norm(self.way))

    @property
    def direction(self) -> Floats:
        """The direction of the way in the plane, a unit vector (2,)."""
        return self.way[:2] / self.distance


def push_candidates(
    vertices: Floats,
    model: Floats,
    gripper: Gripper,
    *,
    distance: float = 0.1,
    height: float = 0.5,
) -> list[Push]:
    """Pushes of an object in all directions of the plane that it stands on, best first.

    The object is (N, 3) vertices in its model's frame, whose pose is `model` (4, 4), z up, pushed
    by `distance` metres at a `height` that is a share of its own.
    """
    placed = vertices @ model[:3, :3].T + model[:3, 3]
    hull = shapely.convex_hull(shapely.multipoints(placed[:, :2]))
    if not isinstance(hull, Polygon) or hull.area == 0:
        raise ManipulationError("object: seen from above it has no area; give the mesh of a solid")
    middle = np.array(hull.centroid.coords[0])
    level = placed[:, 2].min() + height * np.ptp(placed[:, 2])
    tip = float(gripper.reaches[-1]) + TIP
    found = []
    for angle in 2 * np.pi / DIRECTIONS * np.arange(DIRECTIONS):
        along = np.array([np.cos(angle), np.sin(angle)])
        contact, squarely = _contact(hull, middle, along)
        pose = np.eye(4)
        pose[:3, 2] = [*along, 0]
        pose[:3, 0] = [-along[1], along[0], 0]
        pose[:3, 1] = np.cross(pose[:3, 2], pose[:3, 0])
        pose[:3, 3] = [*(contact - tip * along), level]
        pose[:3, 3] -= gripper.aside[-1] * pose[:3, 0]
        end, before = pose.copy(), pose.copy()
        end[:2, 3] += distance * along
        before[:2, 3] -= SAFETY * along
        posture = dict(gripper.postures[-1])
        found.append(Push(pose, end, before, posture, squarely))
    return sorted(found, key=lambda push: -push.quality)


def free_pushes(
    pushes: Sequence[Push],
    vertices: Floats,
    model: Floats,
    gripper: Gripper,
    surface: Polygon | MultiPolygon,
    obstacles: Obstacles,
) -> NDArray[np.bool_]:
    """Whether an object stays on its surface in each push (N,), and nothing else is touched."""
    placed = vertices @ model[:3, :3].T + model[:3, 3]
    lifted = placed + np.array((0, 0, GAP))  # free of what it stands on
    free = np.zeros(len(pushes), bool)
    for i, push in enumerate(pushes):
        way = np.append(push.distance * push.direction, 0)
        moved = lifted + way
        if not surface.contains(shapely.convex_hull(shapely.multipoints(moved[:, :2]))):
            continue
        if obstacles.touched_by([convex_body(np.concatenate([lifted, moved]))], [np.eye(4)]):
            continue
        back = (np.linalg.inv(push.end) @ push.pre_push)[:3, 3]
        closed = len(gripper.postures) - 1
        hand = [swept_link(gripper, closed, k, back) for k in range(len(gripper.links))]
        free[i] = not obstacles.touched_by(hand, [push.end] * len(hand))
    return free


def _contact(hull: Polygon, middle: Floats, along: Floats) -> tuple[Floats, float]:
    """Where a finger that moves towards the middle meets a hull, and cos of the angle there."""
    far = middle - 10 * along
    ray = shapely.LineString([far, middle])
    contact = np.array(
        nearest_points(hull.boundary.intersection(ray), shapely.Point(far))[0].coords[0]
    )
    corners = shapely.get_coordinates(hull.exterior)
    edges = np.diff(corners, axis=0)
    apart = [
        shapely.LineString(pair).distance(shapely.Point(contact)) for pair in pairwise(corners)
    ]
    edge = edges[int(np.argmin(apart))]
    normal = np.array([edge[1], -edge[0]]) / np.linalg.norm(edge)
    return contact, min(1.0, float(abs(normal @ along)))
