"""The error of manipulation."""

from __future__ import annotations

__all__ = ["ManipulationError"]


class ManipulationError(ValueError):
    """Grippers, objects or actions that cannot be used: the text says what, where and the fix."""
