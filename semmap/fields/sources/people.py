"""What people are and do: fields of view, personal space, and bodies.

Fields of view are cones (reMap, section 5.2.2). Personal space is an asymmetric Gaussian, wider in
front of a person in motion (Kirby, Social Robot Navigation, 2010, section 3.4).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from semmap.fields.checks import as_rigid_rows, positive
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.regions.shaped_region import Cone, Cylinder, shape_of, voxels_of
from semmap.fields.sources.percepts import Gaze, People, PersonMotion
from semmap_vdb import BoolGrid, FloatGrid, Int32Grid


class GazeSource:
    """Makes a map of `inFieldOfView` for each agent.

    Parameters
    ----------
    voxel_size : metres
    angle : the full opening angle of the cone, radians
    reach : length of the cone, metres
    graded : make float32 maps, 1 on the axis of the cone and 0 at its rim, instead of bool maps
    """

    takes = Gaze

    def __init__(
        self,
        vocabulary: Vocabulary,
        *,
        voxel_size: float = 0.05,
        angle: float = 0.5,
        reach: float = 5.0,
        graded: bool = False,
    ) -> None:
        self._property = vocabulary["inFieldOfView"]
        self._voxel_size = positive(voxel_size, "voxel_size")
        self._angle = angle
        self._reach = positive(reach, "reach")
        self._graded = graded
        self.provides = ("inFieldOfView", "attention") if graded else ("inFieldOfView",)

    def __call__(self, percept: Gaze) -> list[RepresentationMap]:
        """Return a map for each agent."""
        return [
            RepresentationMap(
                self._property,
                self._field(np.array(as_rigid_rows(pose, f"the gaze of {agent}"))),
                about=agent,
                time=percept.time,
            )
            for agent, pose in percept.poses.items()
        ]

    def _field(self, pose: NDArray[np.float64]) -> BoolGrid | FloatGrid:
        eye, axis = pose[:, 3], pose[:, 2]
        cone = Cone(eye, axis, self._angle, self._reach)
        if not self._graded:
            seen = BoolGrid(self._voxel_size, False)
            seen.fill(shape_of(cone), True)
            return seen
        voxels = voxels_of(cone, self._voxel_size)
        off = (voxels + 0.5) * self._voxel_size - eye
        angle = np.arccos(np.clip(off @ axis / np.linalg.norm(off, axis=1), -1, 1))
        weight = np.clip(1 - angle / (self._angle / 2), 1 / math.inf, 1)
        graded = FloatGrid(self._voxel_size, 0.0)
        graded.set(voxels, weight.astype(np.float32))
        return graded


def disturbance(person: PersonMotion, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how much somebody at points (N, 2) disturbs a person: (N,), 1 at the person.

    The standard deviation is max(2 v, 0.5) metres ahead at a speed of v m/s, two thirds of that to
    the sides, and half of it behind. Who stands has their heading ahead.
    """
    speed = math.hypot(person.vx, person.vy)
    heading = math.atan2(person.vy, person.vx) if speed > 0.05 else person.yaw
    ahead = max(2 * speed, 0.5)
    off = points - (person.x, person.y)
    along = off @ (math.cos(heading), math.sin(heading))
    aside = off @ (-math.sin(heading), math.cos(heading))
    spread = np.where(along >= 0, ahead, ahead / 2)
    return np.exp(-((along / spread) ** 2 + (aside / (ahead * 2 / 3)) ** 2) / 2)


class PersonalSpaceSource:
    """Makes a float32 map of `inPersonalSpace` for each person.

    Parameters
    ----------
    voxel_size : metres
    height : of the field above the floor, metres
    least : the smallest value that a voxel gets
    """

    takes = People
    provides = ("inPersonalSpace", "personalSpace")

    def __init__(
        self,
        vocabulary: Vocabulary,
        *,
        voxel_size: float = 0.05,
        height: float = 2.0,
        least: float = 0.05,
    ) -> None:
        self._property = vocabulary["inPersonalSpace"]
        self._voxel_size = positive(voxel_size, "voxel_size")
        self._height = positive(height, "height")
        self._least = positive(least, "least")

    def __call__(self, percept: People) -> list[RepresentationMap]:
        """Return a map for each person."""
        return [
            RepresentationMap(self._property, self._field(motion), about=name, time=percept.time)
            for name, motion in percept.people.items()
        ]

    def _field(self, person: PersonMotion) -> FloatGrid:
        size = self._voxel_size
        ahead = max(2 * math.hypot(person.vx, person.vy), 0.5)
        reach = ahead * math.sqrt(-2 * math.log(min(self._least, 1.0)))
        low = np.floor((np.array([person.x, person.y]) - reach) / size).astype(int)
        high = np.floor((np.array([person.x, person.y]) + reach) / size).astype(int)
        x, y = np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True)))
        columns = np.column_stack([x.ravel(), y.ravel()])
        value = disturbance(person, (columns + 0.5) * size)
        columns, value = columns[value >= self._least], value[value >= self._least]
        levels = np.arange(round(person.z / size), max(round((person.z + self._height) / size), 1))
        voxels = np.column_stack(
            [np.repeat(columns, len(levels), axis=0), np.tile(levels, len(columns))]
        )
        grid = FloatGrid(size, 0.0)
        grid.set(voxels.astype(np.int32), np.repeat(value, len(levels)).astype(np.float32))
        return grid


class StandingPeopleSource:
    """Makes an int32 map of `containsPerson`: a standing body at the position of each person.

    Edge of voxels, radius and height of a body are metres.
    """

    takes = People
    provides = ("containsPerson",)

    def __init__(
        self,
        vocabulary: Vocabulary,
        *,
        voxel_size: float = 0.05,
        radius: float = 0.25,
        height: float = 1.75,
    ) -> None:
        self._property = vocabulary["containsPerson"]
        self._voxel_size = positive(voxel_size, "voxel_size")
        self._radius = positive(radius, "radius")
        self._height = positive(height, "height")

    def __call__(self, percept: People) -> list[RepresentationMap]:
        """Return the map of all people; none if there are none."""
        if not percept.people:
            return []
        grid, legend = Int32Grid(self._voxel_size, 0), {}
        for number, (name, person) in enumerate(percept.people.items(), 1):
            middle = (person.x, person.y, person.z + self._height / 2)
            voxels = voxels_of(Cylinder(middle, self._radius, self._height), self._voxel_size)
            grid.set(voxels, np.full(len(voxels), number, np.int32))
            legend[number] = name
        return [RepresentationMap(self._property, grid, legend=legend, time=percept.time)]
