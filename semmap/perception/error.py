"""The error of perception."""

from __future__ import annotations

from semmap.error import Error


class PerceptionError(Error, ValueError):
    """A cloud or mesh that cannot be used: the text says what, where and the fix."""
