"""The error of manipulation."""

from semmap.error import Error


class ManipulationError(Error, ValueError):
    """Grippers, objects or actions that cannot be used: the text says what, where and the fix."""
