"""Fields of view: one cone for each agent (reMap, section 5.2.2)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from semmap.fields.checks import as_rigid_rows, positive
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.regions.shapes import Cone, shape_of, voxels_of
from semmap.fields.sources.percepts import Gaze
from semmap_vdb import BoolGrid, FloatGrid


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
