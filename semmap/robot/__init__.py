"""Robots from URDF: their parts, with intervals of height and footprints."""

from semmap.robot.error import RobotError
from semmap.robot.grouping import LinkGroup, find_groups, read_groups
from semmap.robot.parts import Part, footprint_string, robot_parts
from semmap.robot.urdf import Robot, load_robot

__all__ = [
    "LinkGroup",
    "Part",
    "Robot",
    "RobotError",
    "find_groups",
    "footprint_string",
    "load_robot",
    "read_groups",
    "robot_parts",
]
