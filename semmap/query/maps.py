"""Which map a connection sees, and one state of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import psycopg
from sqlalchemy import Connection, Engine, text

from semmap.query.entity_query import pick_map

__all__ = ["current_name", "see_map", "snapshot"]


def current_name(connection: Connection) -> str:
    """The name of the map that a connection sees.

    Raises
    ------
    LookupError
        There is none of the name that was chosen, none at all, or several and none was chosen.
    """
    driver = connection.connection.driver_connection
    assert isinstance(driver, psycopg.Connection)
    return pick_map(driver)


def see_map(connection: Connection, name: str | None) -> str:
    """Let the rest of a transaction see the map of a name, that of `current_name` where None.

    Raises
    ------
    LookupError
        There is no map at all.
    """
    if name is None:
        name = current_name(connection)
    connection.execute(text("SELECT set_config('semmap.map', :name, true)"), {"name": name})
    return name


@contextmanager
def snapshot(engine: Engine) -> Iterator[Connection]:
    """A transaction that sees one state of the database throughout."""
    with engine.connect().execution_options(isolation_level="REPEATABLE READ") as connection:
        yield connection
