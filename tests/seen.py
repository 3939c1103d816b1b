"""What a connection of a test sees, as the readers of a map take it."""

from __future__ import annotations

from sqlalchemy import Connection

from semmap.query.snapshot import Snapshot

NAME = "SELECT coalesce(nullif(current_setting('semmap.map', true), ''), min(name), '') FROM map"


def seen_by(connection: Connection) -> Snapshot:
    """The map that is set, else the only one."""
    return Snapshot.of(connection, connection.exec_driver_sql(NAME).scalar_one())
