"""Work that goes on through losses of the server."""

from __future__ import annotations

import time
from collections.abc import Callable

import psycopg
from sqlalchemy import Engine
from sqlalchemy.exc import DBAPIError

from semmap.database import Cluster, DatabaseError, open_engine

LOST = (psycopg.Error, DBAPIError, DatabaseError)


def for_ever(cluster: Cluster, work: Callable[[Engine], None]) -> None:
    """Repeat some work, and connect again where the server or the transaction was lost."""
    while True:
        try:
            engine = open_engine(cluster, migrate=False)
        except LOST:
            time.sleep(0.05)
            continue
        try:
            while True:
                work(engine)
        except LOST:
            time.sleep(0.02)
        finally:
            engine.dispose()
