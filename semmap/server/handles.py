"""Handles of the database that requests borrow, by the role with whose rights they act."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import quote

from semmap.api.database import Database, connect

MOST_HANDLES = 16
"""The most handles that requests use at once."""

SECONDS = 60
"""The most seconds of one statement of a request."""


class Handles:
    """Handles that were used wait for the next request; `Turns` bounds how many are in use."""

    def __init__(self, database: Database, seconds: float = SECONDS) -> None:
        self._seconds = seconds
        self._own, self._reading = database.engine.url, database.reading_engine.url
        self._free: defaultdict[str | None, list[Database]] = defaultdict(list)
        self._lock = threading.Lock()

    @property
    def reads_apart(self) -> bool:
        """Whether readers have a login of their own, whose rights no statement can leave."""
        return self._reading != self._own

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
        """Open a handle that its caller closes."""
        reads = role is None and self.reads_apart
        url = self._reading if reads else self._own
        settings = f"-c statement_timeout={1e3 * self._seconds:.0f}"
        if not reads:
            settings += f" -c role={role or 'semmap_reader'}"
        text = url.set(drivername="postgresql").render_as_string(hide_password=False)
        text += f"{'&' if url.query else '?'}options={quote(settings)}"
        return connect(text, migrate=False)

    def close(self) -> None:
        """Close those that wait."""
        with self._lock:
            for handle in (each for waiting in self._free.values() for each in waiting):
                handle.close()
            self._free.clear()

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
