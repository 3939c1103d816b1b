"""The files of the example building, `examples/office`, which a checkout has."""

from __future__ import annotations

from pathlib import Path

from planner.robot_class import RobotClass
from semmap.cli.demo.demo_robot import DemoRobot

__all__ = ["delivery_robot", "demo_robot", "office_files", "office_folder"]


def office_folder() -> Path:
    """The folder of the example building.

    Raises
    ------
    LookupError
        This package was installed without the examples.
    """
    folder = Path(__file__).parents[3] / "examples" / "office"
    if not (folder / "office.sdf").is_file():
        raise LookupError(
            f"{folder} does not exist: run the demo in a checkout of semmap, or name a world file"
        )
    return folder


def office_files() -> list[Path]:
    """The world files of the example building, in the order in which they are imported."""
    folder = office_folder()
    return [folder / "office.sdf", folder / "office_rooms.geojson"]


def demo_robot() -> DemoRobot:
    """The robot of the example building: a base, an arm and a pole, 0.8 m/s."""
    folder = office_folder()
    groups = folder / "delivery_robot_parts.yaml"
    return DemoRobot(folder / "delivery_robot.urdf", groups=groups)


def delivery_robot(name: str = "delivery") -> RobotClass:
    """Robots of its shape."""
    return demo_robot().robot_class(name)
