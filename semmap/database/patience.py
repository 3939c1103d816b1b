"""How long a command waits for a server that takes no connection yet."""

from __future__ import annotations

import time

from psycopg.pq import PGconn, Ping

BUSY_SECONDS = 60.0
"""How long a command waits while the server says that it starts, recovers or stops."""

SILENT_SECONDS = 5.0
"""How long it waits while nobody listens at the address: a server opens its socket first thing."""

PAUSE = 0.1


class Patience:
    """Decides after each failed connection whether to try again; a `busy` one starts or stops."""

    def __init__(self) -> None:
        self._begin = self._heard = time.monotonic()
        self._was_up = False
        self.busy = False

    def allows_another(self, conninfo: str) -> bool:
        """Whether to try to connect again; waits a moment first, unless the server is up.

        The protocol says what state the server is in: an error's text depends on its language.
        """
        state = PGconn.ping(conninfo.encode())
        now = time.monotonic()
        self.busy = state == Ping.REJECT
        if state == Ping.OK:  # it came up just now, or it is up and refuses this login
            again, self._was_up = not self._was_up, True
            return again
        self._was_up = False
        if self.busy:
            self._heard = now
        time.sleep(PAUSE)
        return now < self._begin + BUSY_SECONDS and now < self._heard + SILENT_SECONDS
