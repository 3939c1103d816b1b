"""Percepts: the input of sources, as plain records in the shared frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal

from numpy.typing import ArrayLike
from shapely import MultiPolygon, Polygon, to_wkb

from semmap.fields.regions.mesh_regions import mesh_parts
from semmap.fields.regions.shaped_region import Region
from semmap.geometry.mesh import prism_mesh
from semmap.geometry.morphology import polygons

Pose = ArrayLike
"""A (4, 4) rigid transform: a frame in the shared frame."""


@dataclass(frozen=True, eq=False)
class Segmentation:
    """A depth image in which each pixel has a label.

    Attributes
    ----------
    depth : (H, W) metres along the z axis of the camera; NaN, infinity and 0 where not measured
    labels : (H, W) integers; 0 for no label
    names : the name of each label: a class ("mug") or an entity ("human1")
    intrinsics : fx, fy, cx, cy in pixels; the centre of the first pixel is (0, 0)
    pose : of the optical frame (x right, y down, z ahead)
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
    """The directions in which agents look, at an aware time: the z axis of the pose of each.

    They are by the name of the agent, or of a face that is not recognised yet, as in ROS4HRI.
    """

    poses: Mapping[str, Pose]
    time: datetime


@dataclass(frozen=True)
class PersonMotion:
    """Position, heading and velocity of a person: metres, radians, metres per second."""

    x: float
    y: float
    yaw: float
    vx: float = 0.0
    vy: float = 0.0
    z: float = 0.0


@dataclass(frozen=True, eq=False)
class People:
    """The motions of people by name, at an aware time."""

    people: Mapping[str, PersonMotion]
    time: datetime


@dataclass(frozen=True, eq=False)
class RobotState:
    """The pose of a robot's base, at an aware time, and positions of joints, radians or metres."""

    pose: Pose
    time: datetime
    joints: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Zone:
    """A room or a region of the map: an outline in the xy plane, its bottom and top, metres."""

    name: str
    kind: Literal["room", "region"]
    outline: Polygon | MultiPolygon
    low: float
    high: float

    def as_json(self) -> list[str | float]:
        """Return the zone as a list for `json.dumps`."""
        return [self.name, self.kind, to_wkb(self.outline, hex=True), self.low, self.high]

    def regions(self, voxel_size: float) -> list[Region]:
        """Return the prism of the zone, for voxels of an edge in metres."""
        outline = MultiPolygon(polygons(self.outline))
        return mesh_parts(prism_mesh(outline, self.low, self.high)).regions(voxel_size)


@dataclass(frozen=True, eq=False)
class Zones:
    """All rooms and regions of a map, at an aware time."""

    zones: tuple[Zone, ...]
    time: datetime
