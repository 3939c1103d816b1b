"""Fast reading of many rows."""

from __future__ import annotations

from collections.abc import Sequence, Set
from typing import Any

from psycopg.rows import tuple_row
from sqlalchemy import text

from semmap.query.snapshot import Snapshot


def fetch_rows(
    seen: Snapshot, statement: str, values: Sequence[Any] = (), rows: Any = tuple_row
) -> list[Any]:
    """The rows of SQL with ``%s`` for values, by the driver itself: twice as fast as SQLAlchemy."""
    return seen.session.cursor(binary=True, row_factory=rows).execute(statement, values).fetchall()


_SUPERTYPES = """
SELECT sub, array_agg(super ORDER BY super <> sub, super) AS supers FROM type_closure
WHERE sub = ANY (:types) GROUP BY sub
"""


def read_supertypes(seen: Snapshot, types: Set[str | None]) -> dict[str | None, tuple[str, ...]]:
    """Each of these types with itself and its supertypes, itself first; None has no entry."""
    named = [t for t in types if t]
    if not named:
        return {}
    found = seen.connection.execute(text(_SUPERTYPES), {"types": named})
    return {sub: tuple(supers) for sub, supers in found}
