"""Stairs and ramps by their treads: where a robot stands before and behind them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Point, Polygon

from semmap.geometry.pose import Pose
from semmap.ingest.openings import BEHAVIOURS
from semmap.ingest.world import ConnectorDetail, Entry

STEP, RUN = 0.3, 1.0
"""Metres of height: of the treads at an end of a way, at most, and of those that show its
direction."""

LEVEL = 0.9
"""The least vertical part of the normal of what one walks on."""

STANDING, CLOSE = (0.5, 0.4, 0.3, 0.6, 0.8, 1.0, 1.3), (0.2, 0.1)
"""Metres before the first tread and behind the last at which a robot stands, the preferred distance
first; and at which it has hardly any place."""


class WayEnd(NamedTuple):
    """An end of a way: the middle of its edge (3,), and the level direction off it (3,)."""

    edge: NDArray[np.float64]
    away: NDArray[np.float64]

    def stands(self, room: Polygon | MultiPolygon | None = None) -> NDArray[np.float64]:
        """Where a robot stands (3,): at the first distance in the room, else at the first."""
        distance = None if room is None else self._distance(room, (*STANDING, *CLOSE))
        return self._at(STANDING[0] if distance is None else distance)

    def has_place(self, room: Polygon | MultiPolygon) -> bool:
        """Whether a robot that stands in the room is not close to the edge."""
        return self._distance(room, STANDING) is not None

    def _distance(self, room: Polygon | MultiPolygon, distances: Sequence[float]) -> float | None:
        within = (each for each in distances if room.contains(Point(self._at(each)[:2])))
        return next(within, None)

    def _at(self, distance: float) -> NDArray[np.float64]:
        stands: NDArray[np.float64] = self.edge + distance * self.away
        return stands


def walked_corners(triangles: NDArray[np.float64], level: float = LEVEL) -> NDArray[np.float64]:
    """Return the corners (N, 3) of the triangles (M, 3, 3) whose upper side one walks on.

    `level` is the least vertical part of their normals.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1)
    walked: NDArray[np.float64] = triangles[normals[:, 2] > level * np.maximum(length, 1e-9)]
    return walked.reshape(-1, 3)


def way_ends(walked: NDArray[np.float64]) -> tuple[WayEnd, WayEnd]:
    """Return the lower and the upper end of a way.

    `walked` are the corners (N, 3) of its treads, metres; z is that of the end's treads.
    """
    return _end(walked, 1.0), _end(walked, -1.0)


def notes_on_ends(
    name: str,
    ends: Sequence[WayEnd],
    rooms: Sequence[tuple[str, Polygon | MultiPolygon]],
) -> list[str]:
    """Return a note on each end of a way before which its room, by name, has no place."""
    return [
        f"{room} has no place for a robot {min(STANDING):g} m or more before the {which} end of "
        f"{name}, along it: widen the room, or draw the way as a robot can take it"
        for which, end, (room, outline) in zip(("lower", "upper"), ends, rooms, strict=True)
        if not end.has_place(outline)
    ]


def _end(walked: NDArray[np.float64], up: float) -> WayEnd:
    height = up * walked[:, 2] - (up * walked[:, 2]).min()
    step = min(STEP, height.max() / 2)
    end, next_ = walked[height <= step], walked[(height > step) & (height <= step + RUN)]
    middle = _middle(end)
    away = middle - _middle(next_ if len(next_) else walked)
    away[2] = 0.0
    away /= max(float(np.linalg.norm(away)), 1e-9)
    return WayEnd(middle + float(((end - middle) @ away).max()) * away, away)


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

    `ends` (2, 3) are where a robot stands; the entry's pose is in the frame of the map.
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
