"""The database and the map that the user chose. No command but an import changes a schema."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    import psycopg
    from sqlalchemy import Connection, Engine

    from semmap.api.database import Database
    from semmap.api.map import Map

    Session = psycopg.Connection[Any]

__all__ = [
    "CliOptions",
    "choose_map",
    "chosen_map",
    "chosen_url",
    "database",
    "engine",
    "open_database",
    "open_map",
    "show_map",
]


class CliOptions:
    """What the options before the command say."""

    url: str | None = None
    context: typer.Context | None = None


def chosen_url() -> str | None:
    """The database of the option `--db`; None for that of `SEMMAP_DB`, or the embedded one."""
    return CliOptions.url


@contextmanager
def open_database(*, migrate: bool = False) -> Iterator[Database]:
    """The database that the user chose, through the public API, while it lasts."""
    from semmap.api.database import connect

    with connect(CliOptions.url, migrate=migrate) as chosen:
        yield chosen


@contextmanager
def chosen_map(name: str | None) -> Iterator[Map]:
    """The map of a name, else the chosen one, else the only one, while its database is open.

    Raises
    ------
    typer.BadParameter
        There is no such map, none at all, or several and none is chosen.
    """
    with open_database() as opened:
        try:
            found = opened.map(name)
        except LookupError as error:
            raise typer.BadParameter(str(error)) from None
        yield found


def engine(*, migrate: bool = False) -> Engine:
    """An engine on the database that the user chose; closed when the command ends.

    Parameters
    ----------
    migrate : make the schema or bring it to the newest revision; without it, a database that lacks
        it is refused with the command that helps
    """
    from semmap.database.engine import connect

    chosen = connect(CliOptions.url, migrate=migrate, check=not migrate)
    if CliOptions.context is not None:
        CliOptions.context.call_on_close(chosen.dispose)
    return chosen


@contextmanager
def database(*, migrate: bool = False) -> Iterator[Engine]:
    """An engine on the database that the user chose, while it lasts; `migrate` as in `engine`."""
    from semmap.database.engine import connect

    chosen = connect(CliOptions.url, migrate=migrate, check=not migrate)
    try:
        yield chosen
    finally:
        chosen.dispose()


@contextmanager
def open_map(name: str | None) -> Iterator[Connection]:
    """A connection that sees the map of a name; without one, the map that `choose_map` takes."""
    with database() as engine, engine.connect() as connection:
        choose_map(connection, name)
        yield connection


def choose_map(connection: Connection, name: str | None) -> str:
    """Let a connection's views show the map of a name, else the chosen one, else the only one.

    Returns the map's name.

    Raises
    ------
    typer.BadParameter
        There is no such map, none at all, or several and none is chosen.
    """
    return show_map(connection.connection.driver_connection, name)  # type: ignore[arg-type]


def show_map(session: Session, name: str | None) -> str:
    """Let a session of psycopg see a map, as `choose_map` does."""
    from semmap.database.maps import pick_map, see_map

    try:
        return see_map(session, pick_map(session, name), lasting=True)
    except LookupError as error:
        raise typer.BadParameter(str(error)) from None
