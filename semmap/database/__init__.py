"""The database: by URL, or the user's own embedded cluster; its schema brought up to date."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from semmap.database.embedded import Cluster
from semmap.database.error import DatabaseError
from semmap.database.session import open_session

if TYPE_CHECKING:
    from semmap.database.engine import connect, database_url
    from semmap.database.reader import as_reader

__all__ = ["Cluster", "DatabaseError", "as_reader", "connect", "database_url", "open_session"]


def __getattr__(name: str) -> Any:
    """Load what needs SQLAlchemy when it is used: a short command waits for its import."""
    if name in ("connect", "database_url"):
        from semmap.database import engine

        return getattr(engine, name)
    if name == "as_reader":
        from semmap.database.reader import as_reader

        return as_reader
    raise AttributeError(f"module {__name__} has no attribute {name}")
