"""The error of robot descriptions."""

from semmap.error import Error


class RobotError(Error, ValueError):
    """A robot description that cannot be used: the text names file, element and fix."""
