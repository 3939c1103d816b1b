"""The error of interlinking."""

from __future__ import annotations

from semmap.error import Error


class InterlinkingError(Error, ValueError):
    """A data set or labels that cannot be used: what is wrong, where, and how to fix it."""
