"""What a connection of a test sees, as the readers of a map take it."""

from __future__ import annotations

from typing import Any

import psycopg
from sqlalchemy import Connection

from semmap.database.maps import driver_of
from semmap.query.snapshot import Snapshot

NAME = "SELECT coalesce(nullif(current_setting('semmap.map', true), ''), min(name), '') FROM map"


def seen_by(connection: Connection | psycopg.Connection[Any]) -> Snapshot:
    """The map that is set, else the first one."""
    row = driver_of(connection).execute(NAME).fetchone()
    assert row is not None
    if isinstance(connection, psycopg.Connection):
        return Snapshot(connection, row[0])
    return Snapshot.of(connection, row[0])


def cursor(seen: Snapshot) -> str:
    """Where what is seen lies in the history of the database."""
    row = seen.session.execute("SELECT change_cursor()").fetchone()
    assert row is not None
    return str(row[0])
