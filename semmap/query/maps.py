"""Which map a connection sees, and one state of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy import Connection, Engine, text

__all__ = ["current_name", "see_map", "snapshot"]


def current_name(connection: Connection) -> str:
    """The name of the map that a connection sees.

    Raises
    ------
    LookupError
        There is none of the name that was chosen, or none at all.
    """
    name, said = connection.execute(
        text("SELECT (SELECT name FROM map WHERE id = current_map()), "
             "current_setting('semmap.map', true)")
    ).one()  # fmt: skip
    if name is None:
        missing = f" named {said}" if said else ""
        raise LookupError(f"there is no map{missing}: semmap import FILE makes one")
    return str(name)


def see_map(connection: Connection, name: str | None) -> str:
    """Let the rest of a transaction see the map of a name, the newest one where None; its name.

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
