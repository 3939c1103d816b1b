"""What changes in a map: the changes after a cursor, and a subscription to those that come."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Self

import psycopg

from semmap.api.map_questions import MapQuestions
from semmap.database.shared_engine import SharedConnection
from semmap.query.entity_query import check_cursor

if TYPE_CHECKING:
    from semmap.query.map_events import MapEvent

LOOK = 0.5
"""Seconds after which a follower looks although nothing was announced, or tries to connect."""


class MapSubscription:
    """A thread that calls a function with each change of a map; stop it, or use it in ``with``.

    `cursor` is after the last event that the function has taken; `error` is what ended it: raised
    by the function, or since the map was dropped or changes after the cursor are not kept.
    """

    def __init__(
        self,
        conninfo: str,
        map_name: str,
        callback: Callable[[MapEvent], object],
        since: str | None,
    ) -> None:
        self.error: Exception | None = None
        self._conninfo, self._map_name, self._callback = conninfo, map_name, callback
        self._stop = threading.Event()
        session = SharedConnection.reopen(conninfo)
        try:
            session.execute("LISTEN semmap")
            self.cursor: str = current_cursor(session) if since is None else since
        except BaseException:
            session.close()
            raise
        self._thread = threading.Thread(target=self._run, args=(session,), daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether it still calls the function."""
        return self._thread.is_alive() and not self._stop.is_set()

    def stop(self) -> None:
        """End the thread, after the event in progress; raises `error` where there is one."""
        self._stop.set()
        if self._thread is not threading.current_thread():
            self._thread.join()
        if self.error is not None:
            raise self.error

    def __enter__(self) -> Self:
        """Return this; the end of the ``with`` block stops it."""
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _run(self, session: psycopg.Connection[Any] | None) -> None:
        try:
            while not self._stop.is_set():
                try:
                    if session is None:
                        session = SharedConnection.connect(self._conninfo, autocommit=True)
                        session.execute("LISTEN semmap")
                    self._deliver(session)
                except psycopg.OperationalError:  # the server was away: the cursor outlives that
                    if session is not None:
                        session.close()
                    session = None
                    self._stop.wait(LOOK)
        except Exception as error:
            self.error = error
        finally:
            if session is not None:
                session.close()

    def _deliver(self, session: psycopg.Connection[Any]) -> None:
        """Call the function with what is new, then wait for more."""
        from semmap.query.map_events import events_since
        from semmap.query.snapshot import Snapshot

        cursor, events = events_since(Snapshot(session, self._map_name), self.cursor)
        for event in events:
            if self._stop.is_set():
                return
            try:
                self._callback(event)
            except Exception as error:  # not to be taken for an error of this connection
                self.error = error
                self._stop.set()
                return
            self.cursor = event.cursor
        self.cursor = cursor
        for _ in session.notifies(timeout=LOOK, stop_after=1):
            return


def current_cursor(session: psycopg.Connection[Any]) -> str:
    """The position of all changes that are committed."""
    row = session.execute("SELECT change_cursor()").fetchone()
    assert row is not None
    return str(row[0])


class MapEvents(MapQuestions):
    """The part of `Map` that tells changes."""

    def changes(
        self, since: str | None = None, *, follow: bool = False, stop: threading.Event | None = None
    ) -> Iterator[MapEvent]:
        """The changes of the map: one event for each change of an entity by a transaction.

        Parameters
        ----------
        since : the `cursor` of an event that was seen; by default from now on where `follow`, else
            all changes that are kept
        follow : wait for more, until `stop` is set

        Raises
        ------
        ValueError
            `since` is not a cursor.
        """
        check_cursor(since)
        if follow:
            self.connection.execute("LISTEN semmap")
            since = current_cursor(self.connection) if since is None else since
        return _follow(self, since, follow, stop)

    def subscribe(
        self, callback: Callable[[MapEvent], object], *, since: str | None = None
    ) -> MapSubscription:
        """Call a function with each change of the map, in a thread with a connection of its own.

        No change is skipped and none is repeated, also where the server restarts. An exception of
        the function ends the subscription; `MapSubscription.stop` raises it. The subscription is a
        context manager, too.

        Parameters
        ----------
        callback : called in the thread with one event after the other. It must not use this map,
            which is for one thread at a time: let it open its own by `semmap.connect`
        since : the `cursor` of an event that was seen; by default from now on

        Raises
        ------
        ValueError
            `since` is not a cursor.
        """
        check_cursor(since)
        return MapSubscription(self.database.session.conninfo, self.name, callback, since)


def _follow(
    map: MapQuestions, since: str | None, follow: bool, stop: threading.Event | None
) -> Iterator[MapEvent]:
    from semmap.query.map_events import events_since

    while True:
        since, events = events_since(map._seen, since)
        yield from events
        if not follow or (stop is not None and stop.is_set()):
            return
        for _ in map.connection.notifies(timeout=LOOK, stop_after=1):
            break
