"""How long a command waits for a server that takes no connection yet."""

from __future__ import annotations

import time

import psycopg
from psycopg.conninfo import conninfo_to_dict
from psycopg.pq import PGconn, Ping

BUSY_SECONDS = 60.0
"""How long a command waits while the server says that it starts, recovers or stops."""

SILENT_SECONDS = 5.0
"""How long it waits while nobody listens at the address: a server opens its socket first thing.
Where the URL names several servers, `BUSY_SECONDS`: another one takes over."""

PAUSE = 0.1


def has_several_hosts(conninfo: str) -> bool:
    """Whether a connection may be with one of several servers."""
    return "," in str(conninfo_to_dict(conninfo).get("host", ""))


def _lets_in(conninfo: str) -> bool:
    """Whether any of the servers, perhaps one that takes no writes, takes this login."""
    try:
        psycopg.connect(conninfo, target_session_attrs="any").close()
    except psycopg.OperationalError:
        return False
    return True


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
        several = has_several_hosts(conninfo)
        if state == Ping.OK and not (several and _lets_in(conninfo)):
            again, self._was_up = (
                not self._was_up,
                True,
            )  # it came up just now, or refuses this login
            return again
        self._was_up = False
        if self.busy or several:  # of several, one may take over
            self._heard = now
        time.sleep(PAUSE)
        return now < self._begin + BUSY_SECONDS and now < self._heard + SILENT_SECONDS
