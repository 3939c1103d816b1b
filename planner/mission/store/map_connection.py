"""A connection to one map that stays open, so that its session holds locks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Self

from sqlalchemy import Connection, text
from sqlalchemy.exc import DBAPIError

from semmap.database.maps import pick_map, see_map
from semmap.error import Error
from semmap.query.map_handle import MapSource
from semmap.query.snapshot import Snapshot


class MissionError(Error, ValueError):
    """A mission cannot be made or run; the message says why."""


class MapConnection:
    """An open connection that sees one map, for a ``with`` statement.

    Raises MissionError: there is no such map, none at all, or several and none is chosen.
    """

    def __init__(self, source: MapSource) -> None:
        self._connection = source.engine.connect()
        try:
            with self._begin() as connection:
                self.map_name = _see_map(connection, source.name)
        except MissionError:
            self._connection.close()
            raise

    def close(self) -> None:
        """Close the connection and release its locks."""
        if not self._connection.invalidated:
            with suppress(DBAPIError):  # without the server, the locks are released anyway
                self._connection.rollback()
                self._connection.execute(text("SELECT pg_advisory_unlock_all()"))
                self._connection.commit()
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def _snapshot(self) -> Iterator[Snapshot]:
        """What a transaction on this connection sees."""
        with self._begin() as connection:
            yield Snapshot.of(connection, self.map_name)

    def _begin(self) -> _Transaction:
        return _Transaction(self._connection)


class _Transaction:
    """A transaction on a connection that stays open."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def __enter__(self) -> Connection:
        return self._connection

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self._connection.commit()
        elif not self._connection.invalidated:
            self._connection.rollback()


def _see_map(connection: Connection, name: str | None) -> str:
    """Choose the map of a session; returns its name."""
    try:
        return see_map(connection, pick_map(connection, name), lasting=True)
    except LookupError as error:
        raise MissionError(str(error.args[0])) from None
