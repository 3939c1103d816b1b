"""The error of robot descriptions."""

from __future__ import annotations

__all__ = ["RobotError"]


class RobotError(ValueError):
    """A robot description that cannot be used: the text names file, element and fix."""
