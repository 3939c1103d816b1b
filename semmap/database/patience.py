"""How long a command waits for a server that takes no connection yet."""

from __future__ import annotations

import time
from collections.abc import Iterator

import psycopg
from psycopg.conninfo import conninfo_to_dict, make_conninfo
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


def _servers(conninfo: str) -> Iterator[str]:
    """The same for each server that a connection may be with."""
    stated = conninfo_to_dict(conninfo)
    hosts, ports = (str(stated.get(name) or "").split(",") for name in ("host", "port"))
    for number, host in enumerate(hosts):
        if len(hosts) > 1:
            port = ports[number] if len(ports) > 1 else ports[0]
            stated |= {"host": host, "port": port or None, "target_session_attrs": None}
        yield make_conninfo("", **stated)


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
        servers = [*_servers(conninfo)]
        states = {PGconn.ping(each.encode()) for each in servers}
        now = time.monotonic()
        self.busy, several = Ping.REJECT in states, len(servers) > 1
        if Ping.OK in states and not (several and _lets_in(conninfo)):
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
