"""Rows into tables with COPY, also where row-level security forbids it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import psycopg
from psycopg import sql


def copy_rows(
    cursor: psycopg.Cursor[Any], table: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]
) -> None:
    """Insert rows into a table."""
    with (
        writable_table(cursor, table, columns) as into,
        cursor.copy(copy_statement(into, columns)) as copy,
    ):
        for row in rows:
            copy.write_row(row)


def copy_statement(table: str, columns: Sequence[str]) -> sql.Composed:
    """Return the statement that copies rows of these columns into a table."""
    return sql.SQL("COPY {} ({}) FROM STDIN").format(sql.Identifier(table), _names(columns))


def _names(columns: Sequence[str]) -> sql.Composed:
    return sql.SQL(", ").join(map(sql.Identifier, columns))


@contextmanager
def writable_table(
    cursor: psycopg.Cursor[Any], table: str, columns: Sequence[str]
) -> Iterator[str]:
    """Yield a table to COPY into: a temporary one, copied at the end, where policies forbid it."""
    cursor.execute("SELECT row_security_active(%s)", (f"semmap.{table}",))
    (checked,) = cursor.fetchone() or (False,)
    if not checked:
        yield table
        return
    names = {"table": sql.Identifier(table), "columns": _names(columns)}
    cursor.execute(
        sql.SQL(
            "CREATE TEMP TABLE copied_rows ON COMMIT DROP AS "
            "SELECT {columns} FROM {table} WITH NO DATA"
        ).format(**names)
    )
    yield "copied_rows"
    cursor.execute(
        sql.SQL("INSERT INTO {table} ({columns}) SELECT {columns} FROM copied_rows").format(**names)
    )
    cursor.execute("DROP TABLE copied_rows")
