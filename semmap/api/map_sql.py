"""SQL on a map: statements that only read, unless they may write."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any

from psycopg.pq import TransactionStatus

from semmap.api.map_questions import MapQuestions

if TYPE_CHECKING:
    import psycopg

    from semmap.query.sql_statement import SqlRows


class MapSql(MapQuestions):
    """The part of `Map` that runs SQL, and reads with a login that can only read."""

    def sql(self, statement: str, *values: Any, write: bool = False) -> SqlRows:
        """Run a SQL statement that sees this map; one that reads, unless `write` is True.

        On the embedded database it reads with a login that can only read. In a transaction of this
        map it reads what the transaction has changed.

        Parameters
        ----------
        statement : a statement of PostgreSQL, with psycopg's ``%s`` for each of `values`; where
            there are no values, it is run as it stands
        write : let the statement change the map; all of it or nothing

        Returns
        -------
        The rows, a sequence of tuples; `columns` has their names. Where a statement returns none,
        the column `rows` says how many rows it changed.

        Raises
        ------
        ValueError
            The statement is wrong or not allowed; it changed nothing. The driver's error is its
            cause.
        """
        if write:
            return sql_rows(self.connection, statement, values, write=True)
        with self.reading() as session:
            return sql_rows(session, statement, values, write=False)

    @contextmanager
    def reading(self) -> Iterator[psycopg.Connection[Any]]:
        """A psycopg connection that sees this map, for questions.

        On the embedded database, its login can only read. Within a transaction of `connection`, it
        is that connection.
        """
        opened = vars(self).get("connection")
        begun = opened and opened.info.transaction_status != TransactionStatus.IDLE
        yield self.connection if begun else self._reader

    @cached_property
    def _reader(self) -> psycopg.Connection[Any]:
        from semmap.database.maps import see_map
        from semmap.database.reader import reading_session

        session = reading_session(self.database.session)
        if session is None:
            return self.connection
        see_map(session, self.name, lasting=True)
        return session

    def close(self) -> None:
        """Close the map's connections; they are opened again when they are used."""
        if "_reader" in vars(self):
            self._reader.close()
            del self._reader
        super().close()


def sql_rows(
    session: psycopg.Connection[Any], statement: str, values: tuple[Any, ...], *, write: bool
) -> SqlRows:
    """Run a statement on a session as `MapSql.sql` does."""
    from semmap.query.sql_statement import SUPERUSER_NOTE, SqlRows, is_superuser, run_sql

    notes = (SUPERUSER_NOTE,) if not write and is_superuser(session) else ()
    columns, rows = run_sql(session, statement, values, write=write)
    return SqlRows(tuple(columns), tuple(rows), notes)
