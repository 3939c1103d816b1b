"""The robot's body: its links where the joints put them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from semmap.fields.regions.mesh_regions import parts_of
from semmap.fields.regions.shapes import Region, _above_0, _rigid
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.sources.percepts import RobotState
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.robot.urdf import Robot, load_robot

__all__ = ["RobotBodySource"]


class RobotBodySource:
    """One bool map of `containsRobot`.

    Parameters
    ----------
    robot : a robot, or the path of its URDF
    name : what the robot is called; by default as in its URDF
    voxel_size : metres
    """

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
        self._voxel_size = _above_0(voxel_size, "voxel_size")
        self._links = {link: parts_of(mesh) for link, mesh in self._robot.meshes.items()}

    def __call__(self, percept: RobotState) -> list[RepresentationMap]:
        base = np.array([*_rigid(percept.pose, "the robot's pose"), [0, 0, 0, 1]])
        body: list[tuple[Region, bool]] = []
        for link, pose in self._robot.link_poses(percept.joints).items():
            regions = self._links[link].regions(self._voxel_size, base @ pose)
            body += [(region, True) for region in regions]
        return [
            RepresentationMap.of_regions(
                self._property, body, self._voxel_size, about=self._name, time=percept.time
            )
        ]
