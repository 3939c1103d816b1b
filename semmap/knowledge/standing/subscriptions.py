"""Standing queries: what begins and ceases to be an answer, as the map changes."""

from __future__ import annotations

import math
import queue
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import psycopg
from sqlalchemy import Engine

from semmap.database.notifications import SERVER_AWAY
from semmap.error import Error
from semmap.garbage import no_garbage_collection
from semmap.knowledge.answer import plain_value
from semmap.knowledge.map_view import MapView
from semmap.knowledge.sparql.scope import Inferred
from semmap.knowledge.standing.changes import Changes
from semmap.knowledge.standing.queries import (
    Difference,
    StandingQueries,
    StandingQuery,
)
from semmap.query.change_feed import ChangeFeed, Look, shows_fields

PATIENCE = 0.1  # seconds by which the end of a statement may be reported late


@dataclass(frozen=True)
class Event:
    """An answer of a standing query that is new, or that is one no more."""

    subscription: int  # its number
    what: str  # "appeared" or "disappeared"
    bindings: dict[str, Any]  # the terms of the variables that are bound
    map_name: str = field(default="", compare=False)

    @property
    def values(self) -> dict[str, Any]:
        """The plain values of the variables (`semmap.knowledge.answer.plain_value`)."""
        return {name: plain_value(term, self.map_name) for name, term in self.bindings.items()}


@dataclass
class _Subscriber:
    query: StandingQuery
    one_shot: bool
    callback: Callable[[Event], Any] | None


_News = tuple[Callable[[Event], Any] | None, Event | Exception]


class Subscriptions(AbstractContextManager["Subscriptions"]):
    """Standing queries on a map, by default the current one, with one thread that follows it.

    Examples
    --------
    >>> with Subscriptions(engine, "house") as standing:  # doctest: +SKIP
    ...     standing.add("SELECT ?x { ?x semmap:heldBy :kitchen }")
    ...     for event in standing.events():
    ...         print(event.what, event.bindings)
    """

    def __init__(self, engine: Engine, map_name: str | None = None) -> None:
        self._feed = ChangeFeed(engine, map_name, durable=False, one_connection=True)
        self._queries = StandingQueries()
        self._subscribers: dict[int, _Subscriber] = {}
        self._numbers: dict[StandingQuery, list[int]] = defaultdict(list)
        self._news: list[_News] = []
        self._count = 0
        self._due = math.inf
        self._ended_until: datetime | None = None
        self._fields_changed = False
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._events: queue.SimpleQueue[Event | Exception | None] = queue.SimpleQueue()

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the thread, and all loops over events."""
        self._stop.set()
        if self._thread not in (None, threading.current_thread()):
            self._thread.join()
        if self._thread is not threading.current_thread():
            with self._lock:
                self._feed.close()
        self._events.put(None)

    def add(
        self,
        text: str,
        *,
        one_shot: bool = False,
        callback: Callable[[Event], Any] | None = None,
    ) -> tuple[int, int]:
        """Subscribe to one query, as `add_all`, which is faster for many."""
        return self.add_all([text], one_shot=one_shot, callback=callback)[0]

    def add_all(
        self,
        texts: Iterable[str],
        *,
        one_shot: bool = False,
        callback: Callable[[Event], Any] | None = None,
    ) -> list[tuple[int, int]]:
        """Subscribe to queries, each SELECT or ASK: to all or, if one is wrong, to none.

        Returns the number of each subscription, and how many answers there are now, which are no
        events. With `one_shot`, each ends with the first answer that appears, which alone is
        reported. A callback gets the events in the thread that follows the map; else `events`
        yields them. Raises QueryError, KnowledgeError, LookupError, and ValueError where these
        subscriptions are closed.
        """
        if self._stop.is_set():
            raise ValueError("these subscriptions are closed: make new ones")
        with self._lock:
            with self._look() as look:
                view, due = self._catch_up(look)
                queries = self._queries.add(view, texts)
            self._take_in(look, due)
            if self._thread is None:
                self._thread = threading.Thread(target=self._follow, daemon=True)
                self._thread.start()
            numbers = []
            for found in queries:
                self._count += 1
                self._subscribers[self._count] = _Subscriber(found, one_shot, callback)
                self._numbers[found].append(self._count)
                numbers.append((self._count, len(found.counts)))
            return numbers

    def remove(self, number: int) -> None:
        """End a subscription; nothing happens where it has ended."""
        with self._lock:
            self._remove(number)

    def _remove(self, number: int) -> None:
        subscriber = self._subscribers.pop(number, None)
        if subscriber is not None:
            numbers = self._numbers[subscriber.query]
            numbers.remove(number)
            if not numbers:
                del self._numbers[subscriber.query]
                self._queries.remove(subscriber.query)

    def catch_up(self) -> None:
        """Find the events of the last change now, so that the next one cannot undo them unseen.

        The change is made: what hinders this look, the thread that follows the map meets again.
        """
        with suppress(Error, psycopg.Error, *SERVER_AWAY), self._lock:
            if self._subscribers and not self._stop.is_set():
                with self._look() as look:
                    _, due = self._catch_up(look)
                self._take_in(look, due)

    def events(self, timeout: float | None = None) -> Iterator[Event]:
        """Yield the events of subscriptions without a callback; raises what a query failed with."""
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
            self._feed.follow(self._stop, self._wake, patience=PATIENCE, fields=True)
        except Exception as error:  # nothing else reports what ends a thread
            self._events.put(error)

    def _wake(self, payloads: tuple[str, ...] | None) -> None:
        of_fields = [shows_fields(each, self._feed.map_name) for each in payloads or ()]
        fields = payloads is None or any(of_fields)
        self._fields_changed |= fields and self._queries.ask_fields
        no_news = all(of_fields) and payloads is not None and not self._fields_changed
        if no_news and time.monotonic() < self._due and not self._news:
            return
        with no_garbage_collection():
            with self._lock:
                with self._look() as look:
                    _, due = self._catch_up(look)
                self._take_in(look, due)
                news, self._news = self._news, []
            for callback, event in news:
                self._tell(callback, event)

    def _tell(self, callback: Callable[[Event], Any] | None, event: Event | Exception) -> None:
        if callback is None or isinstance(event, Exception):
            self._events.put(event)
            return
        try:
            callback(event)
        except Exception as error:  # of the user's code: one event must not end the others
            self._events.put(error)

    def _look(self) -> AbstractContextManager[Look]:
        values = {"since": self._feed.cursor, "ended_until": self._ended_until}
        return self._feed.look(entities=False, also=(_NEWS, values))

    def _take_in(self, look: Look, due: float) -> None:
        # Only now: a look that fails is repeated.
        self._due, self._ended_until, self._fields_changed = due, look.moment, False
        self._feed.take_in(look)

    def _catch_up(self, look: Look) -> tuple[MapView, float]:
        """Find the events since the last look; return the map, and when the next statement ends."""
        view, changes, due = self._changes(look)
        if self._queries.queries and changes != Changes():
            # At once: a look that is repeated because its end fails finds no difference again.
            for difference in self._queries.update(view, changes):
                self._news += self._events_of(difference)
        return view, due

    def _changes(self, look: Look) -> tuple[MapView, Changes, float]:
        """Return the map, what changed or ended since the last look, and when the next one ends."""
        session = look.seen.session
        ((number, properties, classes, reaches, changed, ended, left),) = look.rows
        assert self._feed.map_name is not None
        view = MapView(session, self._feed.map_name, number) if number else MapView.of(session)
        view.inferred = Inferred(frozenset(properties or ()), frozenset(classes or ()))
        due = math.inf if left is None else time.monotonic() + left
        changed = changed or []
        if not reaches or any(what in _FACTS and not facts for what, _, facts in changed):
            return view, Changes(all=True), due
        facts = [fact for _, _, some in changed for fact in some or ()]
        entities = {n for what, ids, _ in changed if what not in _NO_ENTITIES for n in ids}
        kinds = {what for what, _, _ in changed}
        stated = dict.fromkeys(tuple(fact) for fact in (*facts, *(ended or ())))
        changes = Changes(
            frozenset(entities),
            tuple(stated),
            removed="removed" in kinds,
            others=bool(kinds & _OTHERS),
            fields=self._fields_changed,
        )
        return view, changes, due

    def _events_of(self, difference: Difference) -> Iterator[_News]:
        """Yield the events of the subscribers of a query, each with what gets it."""
        found, gone, come, error = difference
        rows = [
            (what, row)
            for what, some in (("disappeared", gone), ("appeared", come))
            for row in (sorted(some, key=str) if len(some) > 1 else some)
        ]
        for number in list(self._numbers.get(found, ())):
            subscriber, wanted = self._subscribers[number], rows
            if error is not None:
                self._remove(number)
                yield None, error
                continue
            if subscriber.one_shot:
                wanted = [each for each in rows if each[0] == "appeared"][:1]
                if wanted:
                    self._remove(number)
            for what, row in wanted:
                bound = zip(found.names, row, strict=True)
                terms = {n: t for n, t in bound if t is not None}
                yield subscriber.callback, Event(number, what, terms, self._feed.map_name or "")


_OTHERS = frozenset({"belief", "field"})
_FACTS = frozenset({"statement", "inferred"})
_NO_ENTITIES = _OTHERS | _FACTS

_NEWS = """
SELECT m.id, r.properties, r.classes, reaches_back(%(since)s),
       CASE WHEN reaches_back(%(since)s) THEN (
           SELECT jsonb_agg(jsonb_build_array(c.what, c.entities,
                  CASE WHEN jsonb_typeof(c.facts) = 'array' THEN c.facts END))
           FROM changes_since(%(since)s) c WHERE c.map_id = m.id) END,
       (SELECT jsonb_agg(jsonb_build_array(
                   s.graph, coalesce(to_jsonb(s.subject), to_jsonb(s.subject_id)),
                   s.predicate, coalesce(to_jsonb(s.object), to_jsonb(s.object_id)), s.tag))
        FROM statement s
        WHERE s.map_id = m.id AND s.until > %(ended_until)s AND s.until <= statement_timestamp()),
       (SELECT extract(epoch FROM min(s.until) - clock_timestamp())::float8 FROM triple s
        WHERE s.map_id = m.id AND s.until > now())
FROM (SELECT current_map(), set_config('plan_cache_mode', 'force_generic_plan', true)) n (id)
LEFT JOIN map m USING (id) LEFT JOIN reasoning r ON r.map_id = m.id
"""
"""The map, what it has of inferences, whether all changes are kept, which there are, which
statements ended, and the seconds to the next end: from the begin of the transaction on, as queries
of it may have seen it end. Plans are made once: to plan a list of triples takes longer than to read
it."""
