"""Which map a connection sees. No other module sets ``semmap.map``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import psycopg

if TYPE_CHECKING:
    from sqlalchemy import Connection


def driver_of(connection: Connection | psycopg.Connection[Any]) -> psycopg.Connection[Any]:
    """Psycopg's connection: the one given, or that below one of SQLAlchemy."""
    if isinstance(connection, psycopg.Connection):
        return connection
    driver = connection.connection.dbapi_connection  # also of one that left its pool
    assert isinstance(driver, psycopg.Connection)
    return driver


def pick_map(connection: Connection | psycopg.Connection[Any], name: str | None = None) -> str:
    """The name of the map meant: `name`, else the setting ``semmap.map``, else the only one.

    LookupError where there is no such map, none at all, or several and none is chosen.
    """
    execute = driver_of(connection).execute
    known = [row[0] for row in execute("SELECT name FROM map WHERE copy_of IS NULL ORDER BY id")]
    if not known:
        raise LookupError("there is no map yet: semmap import FILE makes one")
    if name is None:
        row = execute("SELECT current_setting('semmap.map', true)").fetchone()
        name = (row and row[0]) or None
    if name is not None and name not in known:
        copies = execute("SELECT name FROM map WHERE copy_of IS NOT NULL ORDER BY id")
        known += [row[0] for row in copies]
    if name is None and len(known) > 1:
        raise LookupError(
            f"there are several maps: {', '.join(known)}. Name one (--map, SEMMAP_MAP), "
            "or choose one for all commands: semmap use MAP"
        )
    if name is not None and name not in known:
        raise LookupError(f"there is no map {name}; there are: {', '.join(known)}")
    return name or str(known[0])


def see_map(
    connection: Connection | psycopg.Connection[Any], name: str | None, *, lasting: bool = False
) -> str:
    """Let a connection see a map, else that of `pick_map`, for a transaction or `lasting`."""
    if name is None:
        name = pick_map(connection)
    driver_of(connection).execute("SELECT set_config('semmap.map', %s, %s)", (name, not lasting))
    return name
