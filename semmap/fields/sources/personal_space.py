"""Personal space: continuous, wider ahead of who walks.

Source: Kirby, Social Robot Navigation (2010), section 3.4: an asymmetric Gaussian whose spread
ahead grows with speed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from semmap.fields.regions.shapes import _above_0
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.sources.percepts import Moving, People
from semmap.fields.maps.vocabulary import Vocabulary
from semmap_vdb import FloatGrid

__all__ = ["PersonalSpaceSource", "disturbance"]


def disturbance(person: Moving, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) how much one disturbs a person at each of (N, 2) points: 1 at the person, falling off.

    The spread (standard deviation, metres) is max(2 v, 1/2) ahead, two thirds of it aside and half
    of it behind; ahead is where the person walks, or looks when standing.
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
    """One float32 map of `inPersonalSpace` a person, from the ground to `height`.

    Parameters
    ----------
    voxel_size : metres
    height : metres above the ground where the person stands
    least : how much a voxel must disturb to have a value
    """

    def __init__(
        self,
        vocabulary: Vocabulary,
        *,
        voxel_size: float = 0.05,
        height: float = 2.0,
        least: float = 0.05,
    ) -> None:
        self._property = vocabulary["inPersonalSpace"]
        self._voxel_size = _above_0(voxel_size, "voxel_size")
        self._height = _above_0(height, "height")
        self._least = _above_0(least, "least")

    def __call__(self, percept: People) -> list[RepresentationMap]:
        return [
            RepresentationMap(self._property, self._field(who), about=name, time=percept.time)
            for name, who in percept.people.items()
        ]

    def _field(self, person: Moving) -> FloatGrid:
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
