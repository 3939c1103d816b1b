"""Doors and other openings: the leaf, and the poses at which a robot faces them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from shapely import LineString, MultiPolygon, Point, Polygon

from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.ingest.world import OUTSIDE, ConnectorDetail, Entry, Shape

LEAF_THICKNESS = 0.05
LEAF_HEIGHT = 2.1
"""Size of a door's leaf, metres."""

BEHAVIOURS = {
    "door": "pass_door",
    "elevator_door": "call_elevator",
    "opening": "drive_through",
    "ramp": "drive_through",
    "stairs": "climb_stairs",
}
"""The behaviour that passing a connector of this form or type needs, unless a file states it."""

APPROACH_DISTANCES = (0.6, 0.5, 0.4, 0.8, 1.0, 0.3, 1.3)
"""Metres from an opening at which a robot may face it, the preferred distance first."""

WIDER = 0.1
"""Metres by which the clear width of a door may exceed its line from post to post: a rough line."""


def door_leaf(width: float) -> Shape:
    """Return the closed leaf of a door in the door's frame: x leads through it, y along it."""
    low = (-LEAF_THICKNESS / 2, -width / 2, 0.0)
    return Shape("box", box_mesh(low, (LEAF_THICKNESS / 2, width / 2, LEAF_HEIGHT)))


def opening_pose(line: LineString, from_left: bool, z: float = 0.0) -> Pose:
    """Return the pose of an opening with this line: x leads through it, from its left or right."""
    (ax, ay), (bx, by) = line.coords[0][:2], line.coords[-1][:2]
    across = math.atan2(by - ay, bx - ax) + (-math.pi / 2 if from_left else math.pi / 2)
    return Pose.planar((ax + bx) / 2, (ay + by) / 2, across, z)


def make_connector(
    entry: Entry,
    frame: Pose,
    places: Sequence[tuple[str, Polygon | MultiPolygon | None]],
    width: float,
    height: float | None = None,
) -> None:
    """Make an entry the door or opening at a frame, between two places with their outlines."""
    (first, before), (second, behind) = (*places, (OUTSIDE, None))[:2]
    entry.pose = frame
    entry.shapes = [] if entry.type == "opening" else [door_leaf(width)]
    entry.detail = ConnectorDetail(
        (first, second),
        (approach_pose(frame, before, -1), approach_pose(frame, behind, 1)),
        type="elevator_door" if entry.type == "elevator_door" else "door",
        behaviour=BEHAVIOURS[entry.type or "door"],
        width=width,
        height=height,
    )


def approach_pose(frame: Pose, place: Polygon | MultiPolygon | None, side: int) -> Pose:
    """Return the pose at which a robot faces an opening, in the opening's frame.

    It is at the first of `APPROACH_DISTANCES` that lies in the place, else at the first of all;
    `frame` is the opening's in that of the place. `side` is -1 before the opening, 1 behind it.
    """
    distance = APPROACH_DISTANCES[0]
    for each in APPROACH_DISTANCES if place is not None else ():
        x, y, _ = frame.apply([(side * each, 0.0, 0.0)])[0]
        if place is not None and place.contains(Point(x, y)):
            distance = each
            break
    return Pose.planar(side * distance, 0.0, 0.0 if side < 0 else math.pi)
