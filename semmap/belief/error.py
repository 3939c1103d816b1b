"""The error of beliefs."""

from __future__ import annotations

from semmap.error import Error


class BeliefError(Error, ValueError):
    """Knowledge or observations that cannot be used: the text says what, where and the fix."""
