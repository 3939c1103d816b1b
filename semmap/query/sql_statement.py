"""One SQL statement as it stands, and its rows."""

from __future__ import annotations

from typing import Any

import psycopg
from psycopg.abc import Buffer, Loader
from psycopg.pq import ExecStatus
from psycopg.types.datetime import DateLoader, TimestampLoader, TimestamptzLoader
from sqlalchemy import Connection

from semmap.query.statements import READING, kind

__all__ = ["is_superuser", "run_sql"]

Rows = tuple[list[str], list[tuple[Any, ...]]]


def run_sql(connection: Connection, statement: str, *, write: bool) -> Rows:
    """Run one statement as it stands; without `write`, one that reads, and can only read.

    Without `write`, the transaction is read-only, and a superuser has the role ``semmap_reader``
    in it. That role is left by a function such as ``set_config``: only a login that is not a
    superuser keeps a hostile statement from it (`semmap.database.as_reader`).

    Raises
    ------
    ValueError
        There is no statement, or it copies from standard input or to standard output, or it does
        not read while `write` is not given.
    """
    driver = connection.connection.driver_connection
    assert isinstance(driver, psycopg.Connection)
    if not statement.strip(" \t\r\n;"):
        raise ValueError("no statement: give one, or - to read it from standard input")
    if not write:
        _check_that_it_reads(driver, statement)
        connection.exec_driver_sql("SET TRANSACTION READ ONLY")
        if is_superuser(connection):
            connection.exec_driver_sql("SET LOCAL ROLE semmap_reader")
    cursor = driver.cursor()
    for name, loader in _LENIENT.items():
        cursor.adapters.register_loader(name, loader)
    try:
        # Prepared, so that it is one statement: no COMMIT in it ends the read-only transaction.
        cursor.execute(statement, prepare=None if write else True)
    except psycopg.ProgrammingError as error:
        if "COPY" not in str(error) or error.sqlstate is not None:
            raise
        connection.invalidate()  # it waits for data that nobody sends
        raise ValueError("semmap sql copies nothing to and fro: semmap db psql does") from None
    if cursor.description is None:
        return ["rows"], [(cursor.rowcount,)]
    return [column[0] for column in cursor.description], cursor.fetchall()


def is_superuser(connection: Connection) -> bool:
    """Whether a connection has the rights of a superuser."""
    return bool(
        connection.exec_driver_sql(
            "SELECT rolsuper FROM pg_roles WHERE rolname = current_user"
        ).scalar()
    )


def _check_that_it_reads(driver: psycopg.Connection[Any], statement: str) -> None:
    word = kind(statement)
    if word in READING:
        return
    parsed = driver.pgconn.prepare(b"", statement.encode())
    if parsed.status != ExecStatus.COMMAND_OK:  # not a statement, or several
        raise psycopg.errors.error_from_result(parsed)
    raise ValueError(
        f"permission denied for {word}: without --write, semmap sql runs {', '.join(READING[:-1])} "
        f"and {READING[-1]}. Add --write to run it with all your rights, or use semmap db psql"
    )


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
