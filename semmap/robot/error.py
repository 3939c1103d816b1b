"""What is wrong with a robot's file."""

from __future__ import annotations

__all__ = ["RobotError"]


class RobotError(ValueError):
    """A robot that cannot be used as it is described: names file, element and fix."""
