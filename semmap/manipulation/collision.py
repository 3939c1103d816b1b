"""Which grasps a gripper can reach without touching anything else than the object.

The links of a gripper are their convex hulls. An approach is a straight move of the open gripper:
the hull of both ends is all that a convex link passes, so it is checked exactly and at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from semmap.arrays import Floats
from semmap.manipulation.candidates import Grasps
from semmap.manipulation.extra import library
from semmap.manipulation.gripper import Gripper

GAP = 0.003
"""Metres by which surfaces of meshes may be uneven."""

_BODIES: WeakKeyDictionary[Gripper, dict[tuple[float, ...], ConvexBody]] = WeakKeyDictionary()
"""Swept links: the passes of all shapes approach along few directions in the grasp frame."""


class ConvexBody:
    """The convex hull of (N, 3) points; `middle` (3,) and `half` (3,) are those of its box."""

    def __init__(self, points: Floats) -> None:
        low, high = points.min(axis=0), points.max(axis=0)
        self.middle, self.half = (low + high) / 2, (high - low) / 2
        # A convex shape collides by the farthest of its points in a direction. FCL uses faces only
        # to find that one among many points, and takes four times as long to prepare them.
        self.shape = library("fcl").Convex(points, 1, np.array([3, 0, 1, 2], np.int32))


def convex_body(points: Floats) -> ConvexBody:
    """The convex hull of (N, 3) points, without those inside of it."""
    try:
        hull = ConvexHull(points)
    except QhullError:  # flat
        hull = ConvexHull(points, qhull_options="QJ")
    return ConvexBody(points[hull.vertices])


def placed(body: ConvexBody, pose: Floats) -> Any:
    """A body at a pose (4, 4), for FCL."""
    fcl = library("fcl")
    return fcl.CollisionObject(body.shape, fcl.Transform(pose[:3, :3], pose[:3, 3]))


def touch(one: Any, other: Any) -> bool:
    """Whether two placed bodies touch."""
    fcl = library("fcl")
    return bool(fcl.collide(one, other, fcl.CollisionRequest(), fcl.CollisionResult()))


class Obstacles:
    """Triangles (F, 3, 3) in the map's frame that a robot must not touch, metres."""

    def __init__(self, triangles: Floats) -> None:
        self.triangles = np.ascontiguousarray(triangles, np.float64).reshape(-1, 3, 3)
        by_axis = self.triangles.transpose(2, 1, 0)
        self._low, self._high = by_axis.min(axis=1), by_axis.max(axis=1)  # (3, F) each

    def __len__(self) -> int:
        return len(self.triangles)

    def within(self, low: Floats, high: Floats) -> Obstacles:
        """The obstacles whose boxes meet a box: quicker to search."""
        met = np.arange(len(self))
        for axis in range(3):  # one after the other: few are left for the second
            met = met[self._low[axis, met] <= high[axis]]
            met = met[self._high[axis, met] >= low[axis]]
        return Obstacles(self.triangles[met])

    def joined(self, triangles: Floats) -> Obstacles:
        """These and more obstacles."""
        return Obstacles(np.concatenate([self.triangles, triangles.reshape(-1, 3, 3)]))

    def touched_by(self, bodies: Sequence[ConvexBody], poses: Sequence[Floats]) -> bool:
        """Whether any of the bodies, each at its pose (4, 4), touches a triangle."""
        return len(self) > 0 and _touched(self._placed, bodies, poses)

    @cached_property
    def _placed(self) -> Any:
        return library("fcl").CollisionObject(self.body)

    @cached_property
    def body(self) -> Any:
        """The triangles as a body of FCL."""
        fcl = library("fcl")
        corners = self.triangles.reshape(-1, 3)
        faces = np.arange(len(corners)).reshape(-1, 3)
        model = fcl.BVHModel()
        model.beginModel(len(corners), len(faces))
        model.addSubModel(corners, faces)
        model.endModel()
        return model


class PlacedObstacles:
    """Obstacles `parts` whose frame is at a pose (4, 4) of another one, such as that of a robot."""

    def __init__(self, parts: Sequence[Obstacles], pose: Floats) -> None:
        self.parts, self.pose = tuple(parts), pose
        fcl = library("fcl")
        there = fcl.Transform(pose[:3, :3], pose[:3, 3])
        self._placed = [fcl.CollisionObject(part.body, there) for part in self.parts if len(part)]

    def joined(self, other: Obstacles) -> PlacedObstacles:
        """These and others in the same frame."""
        return PlacedObstacles([*self.parts, other], self.pose)

    def touched_by(self, bodies: Sequence[ConvexBody], poses: Sequence[Floats]) -> bool:
        """Whether any of the bodies, each at its pose (4, 4) in the other frame, touches one."""
        return any(_touched(part, bodies, poses) for part in self._placed)


def _touched(obstacle: Any, bodies: Sequence[ConvexBody], poses: Sequence[Floats]) -> bool:
    return any(
        touch(placed(body, pose), obstacle) for body, pose in zip(bodies, poses, strict=True)
    )


def free_grasps(
    grasps: Grasps,
    model: Floats,
    obstacles: Obstacles,
    *,
    item: Obstacles | None = None,
) -> NDArray[np.bool_]:
    """Whether the gripper reaches each grasp (N,) without touching an obstacle.

    The open gripper moves straight from pre-grasp to grasp, then closes to the width of the object.

    Parameters
    ----------
    model : (4, 4) of the model in the frame of the obstacles
    obstacles : without the object
    item : the object, which only the closed fingers, or what is soft of a suction cup, may touch
    """
    gripper = grasps.gripper
    links = range(len(gripper.links))
    poses = model @ grasps.poses
    inverse = np.linalg.inv(grasps.poses)
    back = _way((inverse @ grasps.pre_grasps)[:, :3, 3])
    if not len(grasps):
        return np.zeros(0, bool)
    near = obstacles.within(*_box(gripper, poses, back))
    if len(near) >= len(obstacles) / 4:
        near = obstacles  # which FCL has prepared for searches, or prepares once
    moved = [k for k in links if (gripper.poses[0, k] != gripper.poses[-1, k]).any()]
    free = np.ones(len(grasps), bool)
    for i, pose in enumerate(poses):
        way = [swept_link(gripper, 0, link, back[i]) for link in links]
        free[i] = not near.touched_by(way, [pose] * len(way))
        if free[i] and item is not None:
            if gripper.stiff is not None:
                way = [swept_link(gripper, 0, link, back[i], stiff=True) for link in links]
            free[i] = not item.touched_by(way, [pose] * len(way))
        if free[i]:
            posture = gripper.index(float(grasps.widths[i]))
            closed = [swept_link(gripper, posture, link, np.zeros(3)) for link in moved]
            free[i] = not near.touched_by(closed, [pose] * len(closed))
    return free


def free_places(
    places: Grasps, before: Floats, model: Floats, obstacles: Obstacles, item: Floats
) -> NDArray[np.bool_]:
    """Whether the gripper puts an object down at each place (N,) without touching an obstacle.

    Gripper and object (V, 3) move straight from `before` (N, 4, 4) to the pose, the open gripper on
    to the pre-grasp. `model` (4, 4) is where the object is put; the obstacles have its support.
    """
    gripper = places.gripper
    free = free_grasps(places, model, obstacles)
    standing = item @ model[:3, :3].T + model[:3, 3]
    down = _way((np.linalg.inv(places.poses) @ before)[:, :3, 3])
    ways = (model[:3, :3] @ (before - places.poses)[:, :3, 3].T).T
    carried: dict[tuple[float, ...], bool] = {}
    for i in np.flatnonzero(free):
        way = tuple(ways[i].round(6).tolist())
        if way not in carried:
            lifted = standing + np.array((0, 0, GAP))  # free of what it is put on
            body = convex_body(np.concatenate([lifted, lifted + way]))
            carried[way] = not obstacles.touched_by([body], [np.eye(4)])
        posture = gripper.index(float(places.widths[i]))
        links = range(len(gripper.links))
        moving = [swept_link(gripper, posture, link, down[i]) for link in links]
        pose = model @ places.poses[i]
        free[i] = carried[way] and not obstacles.touched_by(moving, [pose] * len(moving))
    return free


def free_way(
    gripper: Gripper,
    width: float,
    pose: Floats,
    box: tuple[Floats, Floats],
    obstacles: Obstacles,
    item: Floats | None = None,
    held: Floats | None = None,
    out: Floats | None = None,
) -> bool:
    """Whether a gripper comes straight from outside of a box to a pose (4, 4).

    The box is the lowest and highest corner; the item (V, 3) that it may hold is `held` (4, 4) in
    the grasp frame; `width` is between the pads, metres. `out` (3,) is the way back, by default
    that along its approach.
    """
    out = -pose[:3, 2] if out is None else out
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = (np.where(out > 0, box[1], box[0]) - pose[:3, 3]) / out
    back = max(0.0, float(np.nanmin(np.where(np.abs(out) > 1e-9, sides, np.inf))))
    posture, move = gripper.index(width), _way(pose[:3, :3].T @ (back * out))
    links = range(len(gripper.links))
    moving = [swept_link(gripper, posture, link, move) for link in links]
    if obstacles.touched_by(moving, [pose] * len(moving)):
        return False
    if item is None or held is None:
        return True
    there = pose @ held
    standing = item @ there[:3, :3].T + there[:3, 3]
    body = convex_body(np.concatenate([standing, standing + back * out]))
    return not obstacles.touched_by([body], [np.eye(4)])


def _hull_points(gripper: Gripper, posture: int, link: int, stiff: bool = False) -> Floats:
    pose = gripper.poses[posture, link]
    corners = (gripper.stiff_hulls if stiff else gripper.hulls)[link]
    points: Floats = corners @ pose[:3, :3].T + pose[:3, 3]
    return points


def _way(metres: Floats) -> Floats:
    """Rounded, so that equal ways are the same key; without the minus of -0."""
    rounded: Floats = metres.round(6) + 0.0
    return rounded


def swept_link(
    gripper: Gripper, posture: int, link: int, back: Floats, *, stiff: bool = False
) -> ConvexBody:
    """The convex hull of a link at the grasp and moved by `back` (3,) metres, grasp frame.

    That of its `stiff` part, or of all of it.
    """
    bodies = _BODIES.setdefault(gripper, {})
    key = (posture, link, *back.tolist(), float(stiff))
    if key not in bodies:
        points = _hull_points(gripper, posture, link, stiff)
        points = np.concatenate([points, points + back]) if back.any() else points
        bodies[key] = ConvexBody(points)
    return bodies[key]


def _box(gripper: Gripper, poses: Floats, back: Floats) -> tuple[Floats, Floats]:
    """The lowest and highest corner of all that the gripper passes."""
    points = np.concatenate([_hull_points(gripper, 0, i) for i in range(len(gripper.links))])
    radius = float(np.linalg.norm(points, axis=1).max())
    before = poses[:, :3, 3] + np.einsum("nij,nj->ni", poses[:, :3, :3], back)
    ends = np.concatenate([poses[:, :3, 3], before])
    return ends.min(axis=0) - radius, ends.max(axis=0) + radius
