"""The example building and its robot, `examples/office`."""

from __future__ import annotations

from pathlib import Path

from planner.robot_class import RobotClass
from semmap.cli.demo.costmaps import DemoRobot

OFFICE = Path(__file__).parents[1] / "examples" / "office"

OFFICE_FILES = (OFFICE / "office.sdf", OFFICE / "office_rooms.geojson")
"""In the order in which they are imported."""

OFFICE_ROBOT = DemoRobot(
    OFFICE / "delivery_robot.urdf", groups=OFFICE / "delivery_robot_parts.yaml"
)
"""A base, an arm and a pole, 0.8 m/s."""


def delivery_robot(name: str) -> RobotClass:
    """Robots of its shape."""
    return OFFICE_ROBOT.robot_class(name)
