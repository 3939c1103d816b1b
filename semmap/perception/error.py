"""The error of perception."""

from __future__ import annotations

__all__ = ["PerceptionError"]


class PerceptionError(ValueError):
    """A cloud or mesh that cannot be used: the text says what, where and the fix."""
