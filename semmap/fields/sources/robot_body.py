"""The body of a robot: its links at the poses that its joints give."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semmap.fields.checks import as_rigid_rows, positive
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.regions.mesh_regions import mesh_parts
from semmap.fields.regions.shaped_region import Region
from semmap.fields.sources.percepts import RobotState
from semmap.robot.urdf import Robot, load_robot


class RobotBodySource:
    """Makes a bool map of `containsRobot`, in voxels of an edge in metres.

    `robot` is a robot or the path of its URDF, whose name counts if none is given.
    """

    takes = RobotState
    provides = ("containsRobot",)

    def __init__(
        self,
        vocabulary: Vocabulary,
        *,
        robot: Robot | Path | str,
        name: str | None = None,
        voxel_size: float = 0.05,
    ) -> None:
        self._property = vocabulary["containsRobot"]
        self._robot = robot if isinstance(robot, Robot) else load_robot(robot)
        self._name = name or self._robot.name
        self._voxel_size = positive(voxel_size, "voxel_size")
        self._links = {link: mesh_parts(mesh) for link, mesh in self._robot.meshes.items()}

    def __call__(self, percept: RobotState) -> list[RepresentationMap]:
        """Return the map of the robot."""
        base = np.array([*as_rigid_rows(percept.pose, "the robot's pose"), [0, 0, 0, 1]])
        body: list[tuple[Region, bool]] = []
        for link, pose in self._robot.link_poses(percept.joints).items():
            regions = self._links[link].regions(self._voxel_size, base @ pose)
            body += [(region, True) for region in regions]
        return [
            RepresentationMap.of_regions(
                self._property, body, self._voxel_size, about=self._name, time=percept.time
            )
        ]
