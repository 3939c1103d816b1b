"""What a robot must open before it sees into it, and where it stands and looks for that."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from planner.robot_class import RobotClass
from planner.routing_graph import Endpoint
from planner.search.line_of_sight import LineOfSight
from planner.search.viewpoints import Aim, Sight
from semmap.arrays import Floats
from semmap.belief.places import BeliefPlace
from semmap.geometry.pose import Pose

OPENING = 8.0  # seconds to open a container
STANDING = 1.0  # metres from a shut container within which the robot can open it
BEYOND = 0.2  # metres outside of the box of a container at which it is seen into
LIFTS = (0.0, 0.05, 0.1, 0.15)  # metres above a point, of which the first free one sees out
BOARD = 0.05  # metres below the top of a place within which a point is in its top board
OPEN = 0.02  # share of all directions from which one must see a point within an open container


def _directions(count: int) -> Floats:
    """(N, 3) unit vectors, evenly over the sphere (a Fibonacci lattice)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = math.pi * (1 + math.sqrt(5)) * (np.arange(count) + 0.5)
    radius = np.sqrt(1 - z * z)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


DIRECTIONS = _directions(100)
"""The directions in which points within a container look out."""


def is_opener(robot: RobotClass) -> bool:
    """Whether a robot opens doors and drawers of furniture."""
    able = robot.behaviours
    return robot.opens and (able is None or "open_container" in able)


def pose_of(end: Endpoint) -> Pose:
    """The pose of an endpoint that has one."""
    assert end.pose is not None
    return end.pose


def enclosed(
    points: Floats, places: Sequence[BeliefPlace], space: LineOfSight
) -> NDArray[np.bool_]:
    """(N,) which points (N, 3), each within its place, see nothing of what is around the place."""
    blind = np.ones(len(points), np.bool_)
    for k, (point, place) in enumerate(zip(points, places, strict=True)):
        assert place.low is not None
        assert place.high is not None
        lifts = point + [(0, 0, lift) for lift in LIFTS]  # out of the voxels of what carries it
        below_top = lifts[:, 2] < place.high[2] - BOARD
        start = lifts[int((space.is_free(lifts) & below_top).argmax())]
        # a ray ends where it has left the box of the place
        exits = np.maximum((place.low - start) / DIRECTIONS, (place.high - start) / DIRECTIONS)
        targets = start + (exits.min(axis=1) + BEYOND)[:, None] * DIRECTIONS
        targets = targets[targets[:, 2] >= place.low[2]]  # nothing looks in from below
        blind[k] = space.sees(start, targets).mean() < OPEN
    return blind


def poses_beside(positions: Floats, floor: float, points: Floats) -> list[Pose]:
    """Poses near shut containers, whatever they show."""
    if not len(points) or not len(positions):
        return []
    away = np.linalg.norm(positions[:, None] - points[None, :, :2], axis=2).min(axis=1)
    return [Pose.planar(float(x), float(y), 0.0, floor) for x, y in positions[away <= 2.0]]


def pose_before(
    container: BeliefPlace,
    stands: Sequence[Endpoint],
    seconds: Floats,
    rooms: Mapping[str, BeliefPlace],
) -> Endpoint | None:
    """The nearest pose beside a container in its room, turned towards it; None if there is none."""
    if container.footprint is None or not len(stands):
        return None
    assert container.low is not None
    middle = container.footprint.centroid
    poses = np.array([pose_of(end)[:3] for end in stands])
    level = abs(poses[:, 2] - container.low[2]) < 2.0
    beside = shapely.distance(shapely.points(poses[:, :2]), container.footprint) <= STANDING
    around = {name for name, room in rooms.items() if shapely.covers(room.footprint, middle)}
    inside = np.array([not around or end.place in around for end in stands], np.bool_)
    near = beside & level & inside & np.isfinite(seconds)
    if not near.any():
        return None
    end = stands[int(np.where(near, seconds, np.inf).argmin())]
    here = pose_of(end)
    yaw = math.atan2(middle.y - here.y, middle.x - here.x)
    return replace(end, pose=Pose.planar(here.x, here.y, yaw, here.z))


def aim_at(container: BeliefPlace, end: Endpoint, sight: Sight) -> Aim:
    """How the camera is held to look into a container before the robot."""
    assert container.footprint is not None
    assert container.low is not None
    assert container.high is not None
    pose = pose_of(end)
    middle = float(container.low[2] + container.high[2]) / 2 - pose.z
    height = min(sight.heights, key=lambda height: abs(height - middle))
    away = max(container.footprint.distance(shapely.Point(pose.x, pose.y)), 0.1)
    down = math.atan2(height - middle, away)
    return Aim(height, min(sight.pitches, key=lambda pitch: abs(pitch - down)))
