"""Whether the database answers: a request learns at once that it is away."""

from __future__ import annotations

import threading
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from typing import TYPE_CHECKING

import psycopg

from semmap.database.error import DatabaseError

if TYPE_CHECKING:
    from sqlalchemy import URL

LOGIN_SECONDS = 2
"""Seconds after which a server that does not answer is away; psycopg waits for no less."""

QUICK = 0.2
"""Seconds that a request waits for the answer of a server that was away."""


class Availability:
    """Asks the server of a database whether it takes connections, once at a time."""

    def __init__(self, url: URL) -> None:
        self._address = url.set(drivername="postgresql").render_as_string(hide_password=False)
        self._lock = threading.Lock()
        self._pool = ThreadPoolExecutor(1, "availability")
        self._asked: Future[bool] | None = None
        self._away = False

    def check(self) -> None:
        """Raise DatabaseError if the database is away; in `QUICK` seconds if it was away before."""
        with self._lock:
            if self._asked is None or self._asked.done():
                self._asked = self._pool.submit(self._answers)
            asked = self._asked
        with suppress(TimeoutError):
            self._away = not asked.result(QUICK if self._away else None)
        if self._away:
            raise DatabaseError("the database does not answer: try again")

    def close(self) -> None:
        """Ask no more."""
        self._pool.shutdown(wait=False)

    def _answers(self) -> bool:
        """Whether a login works; libpq's ping would stop all threads while it waits."""
        try:
            psycopg.connect(self._address, connect_timeout=LOGIN_SECONDS).close()
        except psycopg.OperationalError:
            return False
        return True
