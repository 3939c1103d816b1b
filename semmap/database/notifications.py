"""Notifications of channels, through restarts of the server."""

from __future__ import annotations

import threading
from collections.abc import Generator, Sequence

import psycopg
from sqlalchemy import Engine
from sqlalchemy.exc import DBAPIError

from semmap.database.maps import driver_of

SERVER_AWAY = (psycopg.OperationalError, DBAPIError)
"""What a statement raises while the server is away: sent by psycopg, or by SQLAlchemy."""


def notifications(
    engine: Engine, channels: Sequence[str], stop: threading.Event, *, patience: float = 0.2
) -> Generator[tuple[str, ...] | None]:
    """Listen on channels of `NOTIFY` until `stop` is set, or the generator is closed.

    Yields None after each connect: what was sent before is lost; else the payloads that were sent,
    none after `patience` seconds. Anybody who may connect can send on a channel. The connection is
    the generator's own, and is opened again where the server was away.
    """
    while not stop.is_set():
        try:
            with engine.connect() as connection:
                driver = driver_of(connection)
                connection.detach()  # closed at the end: no other user of the pool listens
                driver.autocommit = True
                for name in map(psycopg.sql.Identifier, channels):
                    driver.execute(psycopg.sql.SQL("LISTEN {}").format(name))
                yield None
                while not stop.is_set():
                    sent = driver.notifies(timeout=patience, stop_after=1)
                    yield tuple(notice.payload for notice in sent)
        except SERVER_AWAY:
            stop.wait(patience)
