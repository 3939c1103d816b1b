"""What sources make maps of: plain records of what a robot perceived, in the shared frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal

from numpy.typing import ArrayLike
from shapely import MultiPolygon, Polygon

__all__ = ["Gaze", "Moving", "People", "RobotState", "Segmentation", "Zone", "Zones"]

Pose = ArrayLike
"""A (4, 4) rigid transform, of a frame in the shared one."""


@dataclass(frozen=True, eq=False)
class Segmentation:
    """A depth image with masks.

    Attributes
    ----------
    depth : (H, W) metres along the camera's z axis; NaN, infinity and 0 are no measurement
    labels : (H, W) integer, the number of what a pixel shows, 0 for nothing
    names : what each number stands for: a class ("mug"), or somebody ("human1")
    intrinsics : fx, fy, cx, cy in pixels, the centre of the first pixel at (0, 0)
    pose : of the optical frame (x right, y down, z ahead) in the shared one
    time : aware
    """

    depth: ArrayLike
    labels: ArrayLike
    names: Mapping[int, str]
    intrinsics: ArrayLike
    pose: Pose
    time: datetime


@dataclass(frozen=True, eq=False)
class Gaze:
    """Where agents look: the pose of a frame whose z axis is the gaze, as ROS4HRI has it.

    Attributes
    ----------
    poses : by the agent's name, or by that of a face that nobody has recognised yet
    """

    poses: Mapping[str, Pose]
    time: datetime


@dataclass(frozen=True)
class Moving:
    """Where somebody is on the ground and how fast: metres, radians, metres a second."""

    x: float
    y: float
    yaw: float
    vx: float = 0.0
    vy: float = 0.0
    z: float = 0.0


@dataclass(frozen=True, eq=False)
class People:
    """Everybody who moves about, by name."""

    people: Mapping[str, Moving]
    time: datetime


@dataclass(frozen=True, eq=False)
class RobotState:
    """Where a robot's base is, and its joints (radians, metres) as far as they are not 0."""

    pose: Pose
    time: datetime
    joints: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Zone:
    """A room or a region of the map: its outline on the ground, from `low` to `high` metres."""

    name: str
    kind: Literal["room", "region"]
    outline: Polygon | MultiPolygon
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Zones:
    """All zones of a map."""

    zones: tuple[Zone, ...]
    time: datetime
