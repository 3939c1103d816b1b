"""The error of beliefs."""

from __future__ import annotations

__all__ = ["BeliefError"]


class BeliefError(ValueError):
    """Knowledge or observations that cannot be used: the text says what, where and the fix."""
