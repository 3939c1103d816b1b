"""Moments that a user gives."""

from __future__ import annotations

from datetime import datetime


def aware(at: datetime | None) -> datetime | None:
    """Return a moment with a time zone, by default that of the machine; None stays."""
    return at if at is None or at.tzinfo else at.astimezone()
