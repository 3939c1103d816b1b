"""Personal space: a continuous field, wider in front of a person in motion.

Source: Kirby, Social Robot Navigation (2010), section 3.4.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from semmap.fields.checks import positive
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.sources.percepts import People, PersonMotion
from semmap_vdb import FloatGrid


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
