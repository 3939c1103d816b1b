"""Standing queries: what begins and ceases to be an answer, as the map changes.

One follower of the change feed evaluates them again when something of the map changed, or when a
statement ended, and compares the answers with the former ones.
"""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import psycopg
from sqlalchemy import Engine, text

from semmap.knowledge.map_view import Row, Session
from semmap.knowledge.queries import Answer, query
from semmap.query.change_feed import ChangeFeed, Look, reaches_back

__all__ = ["Event", "Subscriptions"]

PATIENCE = 0.1
"""Seconds by which the end of a statement may be reported late."""


@dataclass(frozen=True)
class Event:
    """An answer of a standing query that is new, or that is one no more.

    Attributes
    ----------
    subscription : its number
    what : "appeared" or "disappeared"
    bindings : the terms of the variables that are bound; none where the query is ASK
    """

    subscription: int
    what: str
    bindings: dict[str, Any]


@dataclass
class _Standing:
    text: str
    one_shot: bool
    callback: Callable[[Event], Any] | None
    names: tuple[str, ...]
    rows: frozenset[Row]


class Subscriptions:
    """Standing queries on a map, with one thread that follows it.

    Parameters
    ----------
    engine : of the database
    map_name : the current map if not given

    Examples
    --------
    >>> with Subscriptions(engine, "house") as standing:  # doctest: +SKIP
    ...     standing.add("SELECT ?x { ?x semmap:heldBy :kitchen }")
    ...     for event in standing.events():
    ...         print(event.what, event.bindings)
    """

    def __init__(self, engine: Engine, map_name: str | None = None) -> None:
        self._feed = ChangeFeed(engine, map_name, durable=False)
        self._standing: dict[int, _Standing] = {}
        self._count = 0
        self._due = math.inf
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._events: queue.SimpleQueue[Event | Exception | None] = queue.SimpleQueue()

    def __enter__(self) -> Subscriptions:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the thread, and all loops over events."""
        self._stop.set()
        if self._thread not in (None, threading.current_thread()):
            self._thread.join()
        self._events.put(None)

    def add(
        self,
        text: str,
        *,
        one_shot: bool = False,
        callback: Callable[[Event], Any] | None = None,
    ) -> tuple[int, int]:
        """Subscribe to a query; answers that it has now are no events.

        Parameters
        ----------
        text : SELECT or ASK
        one_shot : end with the first answer that appears; it alone is reported
        callback : gets the events, in the thread that follows the map; else `events` yields them

        Returns
        -------
        the number of the subscription, and how many answers there are now

        Raises
        ------
        QueryError, KnowledgeError
            As of `semmap.knowledge.query`.
        ValueError
            The query is neither SELECT nor ASK, or the subscriptions are closed.
        LookupError
            There is no such map.
        """
        if self._stop.is_set():
            raise ValueError("these subscriptions are closed: make new ones")
        with self._lock:
            with self._feed.look() as look:
                answer = query(_session(look), text)
                if answer.form not in ("SELECT", "ASK"):
                    raise ValueError(f"{answer.form} has no answers to follow: use SELECT or ASK")
                # An end that is past, and not reported to others yet, stays due.
                self._due = min(self._due, _next_end(look))
            rows = _rows(answer)
            self._count += 1
            number = self._count
            self._standing[number] = _Standing(text, one_shot, callback, answer.names, rows)
            if self._thread is None:
                self._thread = threading.Thread(target=self._follow, daemon=True)
                self._thread.start()
        return number, len(rows)

    def remove(self, number: int) -> None:
        """End a subscription; nothing happens where it has ended."""
        with self._lock:
            self._standing.pop(number, None)

    def events(self, timeout: float | None = None) -> Iterator[Event]:
        """Yield the events of subscriptions without a callback.

        Parameters
        ----------
        timeout : seconds without an event after which the loop ends; by default never

        Raises
        ------
        ValueError, LookupError
            A query failed, which ends its subscription; or the map is gone.
        """
        while True:
            try:
                event = self._events.get(timeout=timeout)
            except queue.Empty:
                return
            if event is None:
                return
            if isinstance(event, Exception):
                raise event
            yield event

    def _follow(self) -> None:
        try:
            self._feed.follow(self._stop, self._wake, patience=PATIENCE)
        except Exception as error:  # nothing else reports what ends a thread
            self._events.put(error)

    def _wake(self, payloads: tuple[str, ...] | None) -> None:
        if payloads == () and time.monotonic() < self._due:
            return
        with self._lock:
            with self._feed.look() as look:
                answers = self._answers(look) if self._has_news(look) else {}
                due = _next_end(look)
            # Only now: a look that fails is repeated.
            self._due = due
            self._feed.take_in(look)
            found = [each for number, rows in answers.items() for each in self._new(number, rows)]
        for callback, event in found:
            if callback is None or isinstance(event, Exception):
                self._events.put(event)
                continue
            try:
                callback(event)
            except Exception as error:  # of the user's code: one event must not end the others
                self._events.put(error)

    def _has_news(self, look: Look) -> bool:
        """Whether anything of the map changed or ended since the last look."""
        since = self._feed.cursor
        if since is None or time.monotonic() >= self._due:
            return True
        if not reaches_back(look.connection, since):
            return True
        changed = text(
            "SELECT EXISTS (SELECT FROM changes_since(:since) WHERE map_id = current_map())"
        )
        return bool(look.connection.execute(changed, {"since": since}).scalar())

    def _answers(self, look: Look) -> dict[int, frozenset[Row] | Exception]:
        """Return what each subscription has for an answer now, or why it has none."""
        answers: dict[int, frozenset[Row] | Exception] = {}
        for number, standing in self._standing.items():
            try:
                answers[number] = _rows(query(_session(look), standing.text))
            except (ValueError, LookupError) as error:
                answers[number] = error
        return answers

    def _new(
        self, number: int, rows: frozenset[Row] | Exception
    ) -> Iterator[tuple[Callable[[Event], Any] | None, Event | Exception]]:
        """Yield the events of a subscription, each with what gets it."""
        standing = self._standing[number]
        if isinstance(rows, Exception):
            del self._standing[number]
            yield None, rows
            return
        gone, come = standing.rows - rows, rows - standing.rows
        standing.rows = rows
        if standing.one_shot:
            gone, come = frozenset(), frozenset(sorted(come, key=str)[:1])
            if come:
                del self._standing[number]
        for what, some in (("disappeared", gone), ("appeared", come)):
            for row in sorted(some, key=str):
                bound = zip(standing.names, row, strict=True)
                event = Event(number, what, {n: t for n, t in bound if t is not None})
                yield standing.callback, event


def _next_end(look: Look) -> float:
    """Return when the next statement ends, on the clock of `time.monotonic`."""
    # From the begin of the transaction on: queries of this look may have seen it end already.
    left = look.connection.execute(
        text(
            "SELECT extract(epoch FROM min(until) - clock_timestamp())::float8 FROM statement "
            "WHERE map_id = (SELECT current_map()) AND until > now()"
        )
    ).scalar()
    return math.inf if left is None else time.monotonic() + left


def _rows(answer: Answer) -> frozenset[Row]:
    if answer.form == "ASK":
        return frozenset({()} if answer.truth else ())
    return frozenset(answer.rows)


def _session(look: Look) -> Session:
    driver = look.connection.connection.driver_connection
    assert isinstance(driver, psycopg.Connection)
    return driver
