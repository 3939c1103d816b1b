"""Runs statements on connections of SQLAlchemy and of psycopg, which loads sooner."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import psycopg
from psycopg.rows import namedtuple_row

if TYPE_CHECKING:
    import sqlalchemy

Connection: TypeAlias = "sqlalchemy.Connection | psycopg.Connection[Any]"


def run(connection: Connection, statement: str, parameters: Any = None) -> list[Any]:
    """Return the rows of a statement with parameters as `%(name)s`; columns are attributes.

    It runs for each mapping in a list of parameters. The caller commits.
    """
    if not isinstance(connection, psycopg.Connection):
        result = connection.exec_driver_sql(statement, parameters or None)
        return list(result) if result.returns_rows else []
    with connection.cursor(row_factory=namedtuple_row) as cursor:
        if isinstance(parameters, list):
            cursor.executemany(statement, parameters)
        else:
            # blocks of a field are bytes: as text each is twice as long, and read in hexadecimal
            cursor.execute(statement, parameters or None, binary=True)
        return cursor.fetchall() if cursor.description else []
