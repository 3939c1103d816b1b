"""Objects that a robot saw, and places where it looked in vain, as observations of the map."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.belief.error import BeliefError
from semmap.belief.places import ABOVE, BeliefPlace, place_around, place_at, surface_below
from semmap.belief.reader import (
    read_agent_pose,
    read_height,
    read_occluders,
    read_places,
    read_positions,
    read_room_at,
)
from semmap.belief.store.beliefs import Row, add_observations, refuse_far
from semmap.belief.views import camera_at, visible_shares
from semmap.draw.depth_camera import DepthCamera
from semmap.finite_number import finite_numbers
from semmap.geometry.pose import Pose
from semmap.query.snapshot import Snapshot

LEAST_SHARE = 0.02
"""A place of which a view shows less was not looked at."""

HEIGHT = 0.1
"""Metres, of an object whose size is unknown."""


def locate(
    seen: Snapshot,
    what: str,
    places: Iterable[BeliefPlace],
    point: Sequence[float],
    *,
    height: float = 0.0,
    known: NDArray[np.float64] | None = None,
    frame: str | None = None,
    at: datetime | None = None,
) -> tuple[BeliefPlace, list[float]]:
    """Return the place of a detection among those given, and its point in the map's frame.

    The point is in metres in the `frame` of an agent at a moment; None: in that of the map. In an
    opening it belongs to the nearer room.
    `height` is of the object. In the air are only objects that the map has there, such as lamps:
    `known` has where, as `read_positions` says. `BeliefError` if it is at no place: its message
    says `what` was detected.
    """
    numbers = finite_numbers(point, 3)
    if numbers is None:
        raise BeliefError(f"{what} was detected at {tuple(point)}: give x, y, z in metres")
    there = list(numbers)
    refuse_far(there, what)
    if frame is not None:
        there = [float(v) for v in read_agent_pose(seen, frame, at).apply([there])[0]]
    places = list(places)
    place = place_at(places, there, height)
    if place is None and known is not None and _is_near(known, there):
        place = place_around(places, there)
    if place is None and place_around(places, there) is None:
        place = _beside(places, read_room_at(seen, there), there, height)
    if place is None:
        x, y, z = there
        lost = f"{what} was detected at ({x:.2f}, {y:.2f}, {z:.2f}) in the map, "
        below = surface_below(places, there)
        if below is not None and place_around(places, there) is not None:
            raise BeliefError(
                f"{lost}{below[1]:.2f} m above {below[0].name}, where nothing carries it: check "
                "the point and its frame, or add what carries it to the map"
            )
        raise BeliefError(
            f"{lost}where no place has room for it: check the frame, or add the furniture or room "
            "to the map"
        )
    return place, there


def spot(
    seen: Snapshot,
    name: str,
    point: Sequence[float],
    *,
    frame: str | None = None,
    at: datetime | None = None,
    hangs: bool = True,
) -> Row:
    """Return the `place` of a detection and its `position` there, as `add_observations` takes them.

    Only places with room for the object of the name count. What the map has in the air `hangs`
    there: it may be seen there. Other arguments and errors are those of `locate`.
    """
    place, there = locate(
        seen,
        name,
        read_places(seen, name),
        point,
        height=read_height(seen, name) or 0.0,
        known=read_positions(seen, [name], at)[0] if hangs else None,
        frame=frame,
        at=at,
    )
    return {"place": place.name, "position": _within(place.pose, there)}


def observe_point(
    seen: Snapshot,
    name: str,
    point: Sequence[float],
    *,
    frame: str | None = None,
    at: datetime | None = None,
    hangs: bool = True,
    surely: bool = True,
    **values: Any,
) -> Row:
    """Store that an object was detected at a point, and return the stored observation.

    Arguments are those of `spot`; `values` are others of `add_observations`, such as `hit`. Where
    it is not `surely` this object, the place counts alone: the object stays at its point.
    """
    row = {"object": name, "seen": True, "at": at, "observer": frame} | values
    row |= spot(seen, name, point, frame=frame, at=at, hangs=hangs)
    if not surely:
        row["position"] = None
    add_observations(seen.session, [row])
    return row


def observe_view(
    seen: Snapshot,
    camera: DepthCamera,
    looked_for: Collection[str],
    detected: Mapping[str, Sequence[float]] | None = None,
    *,
    furthest: float = 5.0,
    at: datetime | None = None,
    observer: str | None = None,
    **values: Any,
) -> list[Row]:
    """Store detections in a view, and for the other objects that they were looked for and not seen.

    The map's meshes decide which share of each place was in view. The camera's pose and the points
    `detected` are in the map's frame, `furthest` is the range of the detector, metres. `values` are
    the detector's `hit` and `false_alarm`. Returns the stored observations.
    """
    points = dict(detected or {})
    if not furthest > 0:
        raise BeliefError(f"the range of the view is {furthest} m: give a number above 0")
    names = sorted({*looked_for, *points})
    depths, _ = camera.image(read_occluders(seen, names))
    rows: list[Row] = []
    for name in names:
        common = {"object": name, "at": at, "observer": observer} | values
        where = None
        if name in points:
            where = spot(seen, name, points[name])
            rows.append(common | {"seen": True} | where)
        height = read_height(seen, name) or HEIGHT
        shares = visible_shares(
            read_places(seen, name), camera, depths, furthest=furthest, height=height
        )
        rows += [
            common | {"seen": False, "place": place, "visible": share}
            for place, share in shares.items()
            if share >= LEAST_SHARE and not (where and where["place"] == place)
        ]
    add_observations(seen.session, rows)
    return rows


def agent_view(
    seen: Snapshot,
    view: Sequence[float],
    opening: float,
    detected: Mapping[str, Sequence[float]],
    frame: str | None,
    at: datetime | None,
) -> tuple[DepthCamera, dict[str, Sequence[float]]]:
    """Return the camera of a view, and its detections, in the map's frame.

    `view` is x, y, z (metres), yaw and pitch (radians) in the frame of an agent at a moment; None:
    in that of the map. `detected` has points (x, y, z) in the same frame; `opening` is horizontal,
    radians. `BeliefError` for other numbers of numbers.
    """
    numbers = finite_numbers(view, 5)
    if numbers is None:
        raise BeliefError(f"a view is x, y, z, yaw and pitch, not {tuple(view)}")
    for name, point in detected.items():
        if finite_numbers(point, 3) is None:
            raise BeliefError(f"{name} was detected at {tuple(point)}: give x, y, z in metres")
    x, y, z, yaw, pitch = numbers
    there = dict(detected)
    if frame is not None:
        pose = read_agent_pose(seen, frame, at)
        x, y, z = (float(v) for v in pose.apply([[x, y, z]])[0])
        yaw += pose.yaw
        there = {n: [float(v) for v in pose.apply([p])[0]] for n, p in detected.items()}
    return camera_at((x, y, z), yaw, pitch, field_of_view=opening), there


def _beside(
    places: Iterable[BeliefPlace], room: str | None, point: Sequence[float], height: float
) -> BeliefPlace | None:
    """The room of a point in an opening, if it has room for the object and its floor carries it."""
    for place in places:
        if place.name == room and place.low is not None:
            return place if point[2] - place.low[2] <= max(ABOVE, height) else None
    return None


def _is_near(boxes: NDArray[np.float64], point: Sequence[float]) -> bool:
    """Whether one of the boxes of `read_positions` is within `ABOVE` of a point."""
    x, y, z = point
    outside = np.maximum(np.maximum(boxes[:, 2] - z, z - boxes[:, 3]), 0)
    away = np.hypot(np.hypot(boxes[:, 0] - x, boxes[:, 1] - y), outside)
    return bool((away <= ABOVE).any())


def _within(pose: Pose, point: Sequence[float]) -> list[float]:
    """A point of the map in the frame of a place."""
    return [float(v) for v in pose.inverse().apply([point])[0]]
