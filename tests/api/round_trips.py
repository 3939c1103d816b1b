"""How many messages a connection exchanges with the server, as libpq's own trace has them."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import psycopg


@contextmanager
def round_trips(connection: psycopg.Connection[Any]) -> Iterator[list[int]]:
    """Count the statements that the block sends; the list has the count at the end."""
    counted: list[int] = []
    with tempfile.TemporaryFile() as file:
        connection.pgconn.trace(file.fileno())
        try:
            yield counted
        finally:
            connection.pgconn.untrace()
            os.lseek(file.fileno(), 0, os.SEEK_SET)
            lines = file.read().decode(errors="replace").splitlines()
            counted.append(
                sum(
                    line.split("\t")[1:2] == ["F"] and line.split("\t")[3] in ("Query", "Sync")
                    for line in lines
                )
            )
