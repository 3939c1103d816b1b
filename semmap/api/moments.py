"""Moments that a user gives."""

from __future__ import annotations

from datetime import datetime


def aware(at: datetime | None) -> datetime | None:
    """Return a moment with a time zone, by default that of the machine; None stays.

    Examples
    --------
    >>> from datetime import UTC
    >>> aware(datetime(2026, 5, 1, tzinfo=UTC)).isoformat(), aware(datetime(2026, 5, 1)).tzinfo is None
    ('2026-05-01T00:00:00+00:00', False)
    """  # noqa: E501
    return at if at is None or at.tzinfo else at.astimezone()
