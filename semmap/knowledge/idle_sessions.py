"""Sessions that wait for the next request."""

from __future__ import annotations

import select
from collections import defaultdict
from threading import Lock
from typing import Any

import psycopg
from psycopg.pq import TransactionStatus

Session = psycopg.Connection[Any]

MOST = 8
"""Sessions that wait for each role; a session more is closed."""


class IdleSessions:
    """Sessions by role, the last used first."""

    def __init__(self) -> None:
        self._sessions: defaultdict[str | None, list[Session]] = defaultdict(list)
        self._lock = Lock()
        self._closed = False

    def take(self, role: str | None) -> Session | None:
        """Return a session that can be used; None if none waits."""
        while True:
            with self._lock:
                if not self._sessions[role]:
                    return None
                session = self._sessions[role].pop()
            if _is_usable(session):
                return session
            session.close()

    def put(self, role: str | None, session: Session) -> bool:
        """Let a session wait; return whether it may."""
        with self._lock:
            waiting = self._sessions[role]
            if self._closed or len(waiting) >= MOST or not _is_usable(session):
                return False
            waiting.append(session)
            return True

    def close(self) -> None:
        """Close all sessions that wait, and those that are put later."""
        with self._lock:
            self._closed = True
            for session in (s for sessions in self._sessions.values() for s in sessions):
                session.close()
            self._sessions.clear()


def _is_usable(session: Session) -> bool:
    """Return whether a session is between transactions, and its server has not left it."""
    if session.closed or session.info.transaction_status != TransactionStatus.IDLE:
        return False
    poll = select.poll()
    poll.register(session.fileno(), select.POLLIN)
    return not poll.poll(0)  # a server has nothing to say to an idle session but that it ends
