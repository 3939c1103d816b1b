"""Handles of the database that requests borrow, by the role with whose rights they act."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING
from urllib.parse import quote

from semmap.api.database import Database, connect
from semmap.database.role_login import login_url
from semmap.server.availability import Availability

if TYPE_CHECKING:
    from sqlalchemy import URL

MOST_HANDLES = 16
"""The most handles that requests use at once."""

SECONDS = 60
"""The most seconds of one statement of a request."""


class Handles:
    """Handles that were used wait for the next request; `Turns` bounds how many are in use."""

    def __init__(self, database: Database, seconds: float = SECONDS) -> None:
        self._seconds = seconds
        self._engine, self._reading = database.engine, database.reading_engine.url
        self._availability = Availability(self._engine.url)
        self._free: defaultdict[str | None, list[Database]] = defaultdict(list)
        self._lock = threading.Lock()

    @property
    def reads_apart(self) -> bool:
        """Whether readers have a login of their own, whose rights no statement can leave."""
        return self._reading != self._engine.url

    @contextmanager
    def lend(self, role: str | None) -> Iterator[Database]:
        """Lend a handle with the rights of a database role; None: those of a reader."""
        handle = self._take(role) or self.open(role)
        try:
            yield handle
        finally:
            with self._lock:
                self._free[role].append(handle)

    def open(self, role: str | None) -> Database:
        """Open a handle that its caller closes; DatabaseError at once if the database is away."""
        self._availability.check()
        settings = f"-c statement_timeout={1e3 * self._seconds:.0f}"
        login = self._login(role)
        if login is None:
            settings += f" -c role={role or 'semmap_reader'}"
        url = login or self._engine.url
        text = url.set(drivername="postgresql").render_as_string(hide_password=False)
        text += f"{'&' if url.query else '?'}options={quote(settings)}"
        return connect(text, migrate=False)

    def close(self) -> None:
        """Close those that wait."""
        self._availability.close()
        with self._lock:
            for handle in (each for waiting in self._free.values() for each in waiting):
                handle.close()
            self._free.clear()

    def _login(self, role: str | None) -> URL | None:
        """The URL of the role's login; None where it has none, on a database by URL."""
        if not self.reads_apart:
            return None
        return self._reading if role is None else login_url(self._engine, role)

    def _take(self, role: str | None) -> Database | None:
        """A handle that waits, and whose server has not left it."""
        while True:
            with self._lock:
                if not self._free[role]:
                    return None
                handle = self._free[role].pop()
            if handle.is_usable():
                return handle
            handle.close()
