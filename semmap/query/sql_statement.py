"""One SQL statement as it stands, and its rows."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import psycopg
from psycopg.abc import Buffer, Loader
from psycopg.pq import ExecStatus, TransactionStatus
from psycopg.types.datetime import DateLoader, TimestampLoader, TimestamptzLoader

from semmap.database.maps import driver_of
from semmap.html_table import html_table

if TYPE_CHECKING:
    from sqlalchemy import Connection

SUPERUSER_NOTE = (
    "note: this login is a superuser, and a hostile statement could take that right back; "
    "to read what others wrote, log in as a reader (docs/semmap.md)"
)

READING = ("SELECT", "WITH", "VALUES", "TABLE", "EXPLAIN", "SHOW")
"""Statements that return rows and, in a transaction that only reads, change nothing."""

_SPACE = re.compile(r"(?:[\s;(]|--[^\r\n]*)*")
_WORD = re.compile(r"[^\W\d]\w*")
_COMMENT = re.compile(r"/\*|\*/")


@dataclass(frozen=True)
class SqlRows(Sequence[tuple[Any, ...]]):
    """The rows of a SQL statement: a sequence of tuples; `notes` are for its user."""

    columns: tuple[str, ...]  # in order; a name may be there twice
    rows: tuple[tuple[Any, ...], ...]
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """The number of rows."""
        return len(self.rows)

    def __getitem__(self, index: Any) -> Any:
        """A row, or a tuple of rows for a slice."""
        return self.rows[index]

    def as_json(self) -> dict[str, Any]:
        """The columns and the rows."""
        return {"columns": self.columns, "rows": self.rows}

    def _repr_html_(self) -> str:
        return html_table(self.columns, self.rows)


def run_sql(
    connection: Connection | psycopg.Connection[Any],
    statement: str,
    values: Sequence[Any] = (),
    *,
    write: bool,
    most: int | None = None,
) -> tuple[list[str], list[tuple[Any, ...]]]:
    """Run one statement in a transaction, or in that of the connection; return columns and rows.

    More than `most` rows of one that reads are an error; the server sends no more than these.

    Without `write`, it is one statement that reads: the transaction is read-only and undone, and a
    superuser has the role ``semmap_reader`` in it. That role is left by a function such as
    ``set_config``: only a login that is not a superuser keeps a hostile statement from it
    (`semmap.database.reader.reading_session`). A ValueError says what is wrong, or not allowed.
    """
    session = driver_of(connection)
    if not statement.strip(" \t\r\n;"):
        raise ValueError("no statement: give one, or - to read it from standard input")
    try:
        if not write:
            _check_that_it_reads(session, statement)
        limited = most is not None and not write and kind(statement) in READING[:4]
        opened = session.cursor("answer") if limited else session.cursor()
        with session.transaction(force_rollback=not write), opened as cursor:
            if not write:
                session.execute("SET TRANSACTION READ ONLY")
                if is_superuser(session):
                    session.execute("SET LOCAL ROLE semmap_reader")
            for name, loader in _LENIENT.items():
                cursor.adapters.register_loader(name, loader)
            # Prepared, or of a cursor, it is one statement: no COMMIT ends what only reads.
            only = {} if write or limited else {"prepare": True}
            try:
                cursor.execute(statement.encode(), values or None, **only)
            except psycopg.ProgrammingError as error:
                if "COPY" not in str(error) or error.sqlstate is not None:
                    raise
                _end_copy(session)
                raise ValueError(
                    "semmap sql copies nothing to and fro: semmap db psql does"
                ) from None
            if cursor.description is None:
                return ["rows"], [(cursor.rowcount,)]
            columns = [column[0] for column in cursor.description]
            if not limited or most is None:
                return columns, cursor.fetchall()
            rows = cursor.fetchmany(most + 1)
            if len(rows) > most:
                raise ValueError(f"more than {most} rows: add a LIMIT or a condition")
            return columns, rows
    except psycopg.OperationalError:
        raise
    except psycopg.Error as error:
        raise ValueError(_reason(error)) from error


def is_superuser(session: psycopg.Connection[Any]) -> bool:
    """Whether a session has the rights of a superuser."""
    row = session.execute("SELECT rolsuper FROM pg_roles WHERE rolname = current_user").fetchone()
    return row is not None and bool(row[0])


def _end_copy(session: psycopg.Connection[Any]) -> None:
    """Let a session that waits for data, or for somebody who takes its data, go on."""
    if session.pgconn.transaction_status == TransactionStatus.ACTIVE:
        session.cancel()
        with suppress(psycopg.Error):
            session.pgconn.put_copy_end(b"nothing is copied")
        with suppress(psycopg.Error):
            while session.pgconn.get_copy_data(0)[0] > 0:
                pass
        while session.pgconn.get_result() is not None:
            pass


def _reason(error: psycopg.Error) -> str:
    """Why a statement was not run, and what to do."""
    message = ". ".join(filter(None, (error.diag.message_primary, error.diag.message_hint)))
    if isinstance(error, psycopg.errors.ReadOnlySqlTransaction):
        message += ". Add write=True to let the statement change the map"
    return message or str(error).strip()


def _check_that_it_reads(session: psycopg.Connection[Any], statement: str) -> None:
    word = kind(statement)
    if word in READING:
        return
    parsed = session.pgconn.prepare(b"", statement.encode())
    if parsed.status != ExecStatus.COMMAND_OK:  # not a statement, or several
        raise psycopg.errors.error_from_result(parsed)
    raise ValueError(
        f"permission denied for {word}: without write=True, sql runs {', '.join(READING[:-1])} "
        f"and {READING[-1]}. Add write=True to run it with all your rights, or use semmap db psql"
    )


def kind(statement: str) -> str:
    """The first word of a statement in capitals; empty if it does not begin with a word.

    Comments, semicolons and parentheses before it do not count.

    >>> kind("/* a /* b */ */ (select 1)")
    'SELECT'
    """
    position = 0
    while True:
        space = _SPACE.match(statement, position)
        position = space.end() if space else position
        if not statement.startswith("/*", position):
            break
        depth = 0
        for mark in _COMMENT.finditer(statement, position):
            depth += 1 if mark[0] == "/*" else -1
            if depth == 0:
                position = mark.end()
                break
        else:
            return ""
    word = _WORD.match(statement, position)
    return word[0].upper() if word else ""


def _lenient(usual: type[Loader]) -> type[Loader]:
    """A loader that gives what Python has no time for as text: infinity, years before Christ."""

    class Lenient(usual):  # type: ignore[misc, valid-type]
        def load(self, data: Buffer) -> Any:
            try:
                return super().load(data)
            except psycopg.DataError:
                return bytes(data).decode()

    return Lenient


_LENIENT = {
    "timestamptz": _lenient(TimestamptzLoader),
    "timestamp": _lenient(TimestampLoader),
    "date": _lenient(DateLoader),
}
