"""Fast reading of many rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from psycopg.rows import tuple_row

from semmap.query.snapshot import Snapshot


def fetch_rows(
    seen: Snapshot, statement: str, values: Sequence[Any] = (), rows: Any = tuple_row
) -> list[Any]:
    """The rows of SQL with ``%s`` for values, by the driver itself: twice as fast as SQLAlchemy."""
    return seen.session.cursor(binary=True, row_factory=rows).execute(statement, values).fetchall()
