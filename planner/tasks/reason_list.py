"""Joins the reasons against each candidate into one message."""

from __future__ import annotations

from collections.abc import Sequence


def join_reasons(reasons: Sequence[str], most: int = 3) -> str:
    """The first reasons, without repetition."""
    each = list(dict.fromkeys(reasons))
    more = f"; and {len(each) - most} more" if len(each) > most else ""
    return "; ".join(each[:most]) + more
