"""The robot of the demo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from planner.robot_class import RobotClass
from semmap.api.driving_posture import driving_posture
from semmap.geometry.mesh import Mesh
from semmap.robot import LinkGroup, Part, load_robot, robot_parts
from semmap.robot.urdf import Robot


@dataclass(frozen=True)
class DemoRobot:
    """A robot in a joint state: JSON, a file or an SRDF state; `groups` of its links, YAML; m/s."""

    urdf: Path
    state: str | None = None
    groups: Path | None = None
    speed: float = 0.8

    @cached_property
    def _loaded(self) -> tuple[Robot, Mapping[str, float]]:
        chosen = driving_posture(None, self.urdf, self.state, self.groups)
        return load_robot(self.urdf), chosen.joints

    @cached_property
    def parts(self) -> list[Part]:
        """Its parts (Deeken et al., section 4.3)."""
        robot, state = self._loaded
        return robot_parts(robot, state, self.groups)

    @cached_property
    def whole(self) -> Part:
        """All of it as one part."""
        robot, state = self._loaded
        return robot_parts(robot, state, [LinkGroup("robot", robot.links)])[0]

    @cached_property
    def meshes(self) -> Mapping[str, Mesh]:
        """The meshes of its links in this state."""
        robot, state = self._loaded
        return robot.link_meshes(state)

    def robot_class(self, name: str) -> RobotClass:
        """Robots of its shape."""
        return RobotClass(name, tuple(self.parts), speed=self.speed)
