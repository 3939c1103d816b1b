"""The bodies of people of whom only the position is known."""

from __future__ import annotations

import numpy as np

from semmap.fields.checks import positive
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.regions.shapes import Cylinder, voxels_of
from semmap.fields.sources.percepts import People
from semmap_vdb import Int32Grid


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
