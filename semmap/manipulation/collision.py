"""Which grasps a gripper can reach without touching anything else than the object.

The links of a gripper are their convex hulls. An approach is a straight move of the open gripper:
the hull of both ends is all that a convex link passes, so it is checked exactly and at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from semmap.manipulation.candidates import Grasps
from semmap.manipulation.extra import library
from semmap.manipulation.gripper import Gripper

__all__ = [
    "GAP",
    "Obstacles",
    "convex_body",
    "free_grasps",
    "free_places",
    "swept_hull",
    "swept_link",
]

Floats = NDArray[np.float64]

GAP = 0.003
"""Metres by which surfaces of meshes may be uneven."""

_BODIES: WeakKeyDictionary[Gripper, dict[tuple[float, ...], Any]] = WeakKeyDictionary()
"""Swept links: the passes of all shapes approach along few directions in the grasp frame."""


_HULLS: WeakKeyDictionary[Gripper, dict[int, _Hull]] = WeakKeyDictionary()
"""Links by number, each in its own frame."""


class _Hull(NamedTuple):
    """A convex hull that can be swept."""

    corners: Floats
    """(C, 3)"""

    triangles: NDArray[np.intp]
    """(F, 3), seen from outside counterclockwise."""

    edges: NDArray[np.intp]
    """(E, 2) corners, in the order of the first of their two triangles."""

    sides: NDArray[np.intp]
    """(E, 2) the triangles of each edge."""


def convex_body(points: Floats) -> Any:
    """Return the convex hull of (N, 3) points as a shape of FCL."""
    corners, triangles = _hull_of(points)
    return _body(corners, triangles)


def _body(corners: Floats, triangles: NDArray[np.intp]) -> Any:
    faces = np.column_stack([np.full(len(triangles), 3), triangles]).astype(np.int32).ravel()
    return library("fcl").Convex(corners, len(triangles), faces)


def _hull_of(points: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """The corners and the outward triangles of a convex hull."""
    try:
        hull = ConvexHull(points)
    except QhullError:  # flat
        hull = ConvexHull(points, qhull_options="QJ")
    corners = points[hull.vertices]
    number = np.empty(len(points), np.intp)
    number[hull.vertices] = np.arange(len(corners))
    return corners, _outward(corners, number[hull.simplices])


def hull_with_edges(points: Floats) -> _Hull:
    """Return the convex hull of (N, 3) points with its edges, for `swept_hull`."""
    corners, triangles = _hull_of(points)
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    order = np.lexsort(np.sort(edges, axis=1).T)
    first, second = order[::2], order[1::2]  # each edge has two triangles
    return _Hull(corners, triangles, edges[first], np.stack([first, second], axis=1) // 3)


def swept_hull(hull: _Hull, way: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Return the corners and triangles of a hull united with all it passes on a straight way.

    Triangles that face the way move with it, the others stay, and each edge between the two kinds
    leaves a parallelogram: the hull of both ends, without computing one.
    """
    a, b, c = np.moveaxis(hull.corners[hull.triangles], 1, 0)
    ahead = np.cross(b - a, c - a) @ way > 0
    count = len(hull.corners)
    kept = hull.triangles + count * ahead[:, None]
    front = ahead[hull.sides]
    rim = front[:, 0] != front[:, 1]
    # In the order of the triangle ahead, which is the other one where the first stays.
    edges = np.where(front[rim, :1], hull.edges[rim], hull.edges[rim, ::-1])
    here, there = edges, edges + count
    quads = [
        np.column_stack([here, there[:, 1]]),
        np.column_stack([here[:, 0], there[:, 1], there[:, 0]]),
    ]
    triangles = np.concatenate([kept, *quads])
    used, index = np.unique(triangles, return_inverse=True)
    corners = np.concatenate([hull.corners, hull.corners + way])[used]
    return corners, index.reshape(-1, 3)


def _outward(corners: Floats, triangles: NDArray[np.intp]) -> NDArray[np.intp]:
    a, b, c = np.moveaxis(corners[triangles], 1, 0)
    turned = np.einsum("ni,ni->n", np.cross(b - a, c - a), a - corners.mean(axis=0)) < 0
    return np.where(turned[:, None], triangles[:, ::-1], triangles)


class Obstacles:
    """Triangles (F, 3, 3) in the map's frame that a robot must not touch, metres."""

    def __init__(self, triangles: Floats) -> None:
        self.triangles = np.ascontiguousarray(triangles, np.float64).reshape(-1, 3, 3)
        self._low = self.triangles.min(axis=1)
        self._high = self.triangles.max(axis=1)
        self._body: Any = None

    def __len__(self) -> int:
        return len(self.triangles)

    def within(self, low: Floats, high: Floats) -> Obstacles:
        """Return the obstacles whose boxes meet a box: quicker to search."""
        met = np.all((self._low <= high) & (self._high >= low), axis=1)
        return Obstacles(self.triangles[met])

    def joined(self, triangles: Floats) -> Obstacles:
        """Return these and more obstacles."""
        return Obstacles(np.concatenate([self.triangles, triangles.reshape(-1, 3, 3)]))

    def touched_by(self, bodies: Sequence[Any], poses: Sequence[Floats]) -> bool:
        """Return whether any of the bodies, each at its pose (4, 4), touches a triangle."""
        if not len(self):
            return False
        fcl = library("fcl")
        request, result = fcl.CollisionRequest(), fcl.CollisionResult()
        for body, pose in zip(bodies, poses, strict=True):
            placed = fcl.CollisionObject(body, fcl.Transform(pose[:3, :3], pose[:3, 3]))
            if fcl.collide(placed, self._object(), request, result):
                return True
        return False

    def _object(self) -> Any:
        if self._body is None:
            fcl = library("fcl")
            corners, index = np.unique(self.triangles.reshape(-1, 3), axis=0, return_inverse=True)
            faces = index.reshape(-1, 3)
            model = fcl.BVHModel()
            model.beginModel(len(corners), len(faces))
            model.addSubModel(corners, faces)
            model.endModel()
            self._body = fcl.CollisionObject(model)
        return self._body


def free_grasps(
    grasps: Grasps,
    model: Floats,
    obstacles: Obstacles,
    *,
    item: Floats | None = None,
    skip: Iterable[str] = (),
) -> NDArray[np.bool_]:
    """Return (N,) whether the gripper reaches each grasp without touching an obstacle.

    The open gripper moves straight from pre-grasp to grasp, then closes to the width of the object.

    Parameters
    ----------
    grasps : Grasps
    model : (4, 4)
        The pose of the model in the frame of the obstacles.
    obstacles : Obstacles
        Without the object.
    item : (F, 3, 3) triangles of the object, which only the closed fingers may touch
    skip : names of links that are not checked
    """
    gripper = grasps.gripper
    left_out = frozenset(skip)
    chosen = [i for i, link in enumerate(gripper.links) if link not in left_out]
    poses = model @ grasps.poses
    inverse = np.linalg.inv(grasps.poses)
    back = (inverse @ grasps.pre_grasps)[:, :3, 3]
    if not len(grasps):
        return np.zeros(0, bool)
    near = obstacles.within(*_box(gripper, poses, back))
    there = near if item is None else near.joined(item)
    moved = [k for k in chosen if any(gripper.links[k] in f for f in gripper.fingers)]
    free = np.ones(len(grasps), bool)
    for i, pose in enumerate(poses):
        way = [swept_link(gripper, 0, link, back[i]) for link in chosen]
        free[i] = not there.touched_by(way, [pose] * len(way))
        if free[i]:
            posture = gripper.index(float(grasps.widths[i]))
            closed = [swept_link(gripper, posture, link, np.zeros(3)) for link in moved]
            free[i] = not near.touched_by(closed, [pose] * len(closed))
    return free


def free_places(
    places: Grasps, before: Floats, model: Floats, obstacles: Obstacles, item: Floats
) -> NDArray[np.bool_]:
    """Return (N,) whether the gripper puts an object down without touching an obstacle.

    The closed gripper and the object move straight to the pose; the open gripper moves straight
    away from it, which is the way of a grasp reversed.

    Parameters
    ----------
    places : Grasps
        Their pre-grasps are the ends of the retreats.
    before : (N, 4, 4) where the gripper begins to move down, in the frame of the model
    model : (4, 4)
        The pose at which the object is put, in the frame of the obstacles.
    obstacles : without the object, with what it is put on
    item : (V, 3) vertices of the object, in its model's frame
    """
    gripper = places.gripper
    free = free_grasps(places, model, obstacles)
    standing = item @ model[:3, :3].T + model[:3, 3]
    down = (np.linalg.inv(places.poses) @ before)[:, :3, 3]
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


def _hull_points(gripper: Gripper, posture: int, link: int) -> Floats:
    pose = gripper.poses[posture, link]
    corners = gripper.robot.hull(gripper.links[link])
    points: Floats = corners @ pose[:3, :3].T + pose[:3, 3]
    return points


def swept_link(gripper: Gripper, posture: int, link: int, back: Floats) -> Any:
    """Return the convex hull of a link at the grasp and moved by `back`, in the grasp frame.

    Parameters
    ----------
    posture, link : numbers in the gripper's `poses`
    back : (3,) metres
    """
    bodies = _BODIES.setdefault(gripper, {})
    key = (posture, link, *(back.round(6) + 0.0).tolist())
    if key not in bodies:
        hulls = _HULLS.setdefault(gripper, {})
        if link not in hulls:
            hulls[link] = hull_with_edges(gripper.robot.hull(gripper.links[link]))
        pose = gripper.poses[posture, link]
        placed = hulls[link].corners @ pose[:3, :3].T + pose[:3, 3]
        hull = hulls[link]._replace(corners=placed)
        bodies[key] = _body(*(swept_hull(hull, back) if back.any() else hull[:2]))
    return bodies[key]


def _box(gripper: Gripper, poses: Floats, back: Floats) -> tuple[Floats, Floats]:
    """The lowest and highest corner of all that the gripper passes."""
    points = np.concatenate([_hull_points(gripper, 0, i) for i in range(len(gripper.links))])
    radius = float(np.linalg.norm(points, axis=1).max())
    before = poses[:, :3, 3] + np.einsum("nij,nj->ni", poses[:, :3, :3], back)
    ends = np.concatenate([poses[:, :3, 3], before])
    return ends.min(axis=0) - radius, ends.max(axis=0) + radius
