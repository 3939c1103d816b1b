"""Distributes events within a process: each subscriber gets each event once, in order."""

from __future__ import annotations

import logging
import queue
import threading
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from semmap.fields.relations.facts import RelationEvent

logger = logging.getLogger(__name__)

Callback = Callable[[RelationEvent], object]


@dataclass(frozen=True, eq=False)
class Subscription:
    """A callback and the events that it gets, until it is cancelled."""

    callback: Callback  # called with each event
    # relation, subject, object: only events with these; None for any
    relation: str | None
    subject: Hashable | None
    object: Hashable | None
    _cancel: Callable[[Subscription], None]

    def cancel(self) -> None:
        """End the subscription; an event that is being distributed may still arrive."""
        self._cancel(self)

    def wants(self, event: RelationEvent) -> bool:
        """Return whether the subscription includes an event."""
        return (
            self.relation in (None, event.relation)
            and self.subject in (None, event.subject)
            and self.object in (None, event.object)
        )

    def __enter__(self) -> Subscription:
        return self

    def __exit__(self, *_: Any) -> None:
        self.cancel()


class EventStream:
    """Events to loop over as they arrive, until it is closed or its `with` block ends."""

    def __init__(self, subscribe: Callable[[Callback], Subscription]) -> None:
        self._waiting: queue.SimpleQueue[RelationEvent | None] = queue.SimpleQueue()
        self._subscription = subscribe(self._waiting.put)

    def __iter__(self) -> Iterator[RelationEvent]:
        while (event := self._waiting.get()) is not None:
            yield event
        self._waiting.put(None)  # for the next loop, or that of another thread

    def get(self, timeout: float | None = None) -> RelationEvent | None:
        """Return the next event; None if the stream is closed, or none came in `timeout` s."""
        try:
            event = self._waiting.get(timeout=timeout)
        except queue.Empty:
            return None
        if event is None:
            self._waiting.put(None)
        return event

    def close(self) -> None:
        """End the subscription; loops end after the events that arrived before."""
        self._subscription.cancel()
        self._waiting.put(None)

    def __enter__(self) -> EventStream:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class EventBus:
    """Subscriptions, and the events that are distributed to them. Safe for several threads.

    Examples
    --------
    >>> from datetime import UTC, datetime
    >>> bus = EventBus()
    >>> with bus.subscribe(print, relation="sees", object="book_326"):
    ...     for began in (True, False):
    ...         time = datetime.now(UTC)
    ...         bus.publish([RelationEvent("sees", "human1", "book_326", began, time)])
    human1 sees book_326 begins
    human1 sees book_326 ends
    """

    def __init__(self) -> None:
        self._subscriptions: tuple[Subscription, ...] = ()
        self._waiting: deque[RelationEvent] = deque()
        self._distributing = False
        self._lock = threading.Lock()

    def subscribe(
        self,
        callback: Callback,
        *,
        relation: str | None = None,
        subject: Hashable | None = None,
        object: Hashable | None = None,
    ) -> Subscription:
        """Call a function with each event from now on, in the thread that publishes.

        Only events with `relation`, `subject` and `object` if given. Its exceptions are logged.
        """
        subscription = Subscription(callback, relation, subject, object, self._cancel)
        with self._lock:
            self._subscriptions = (*self._subscriptions, subscription)
        return subscription

    def stream(self, **chosen: Any) -> EventStream:
        """Return the events from now on as `subscribe` chooses them, to loop over in a thread."""
        return EventStream(partial(self.subscribe, **chosen))

    def publish(self, events: Iterable[RelationEvent]) -> None:
        """Distribute events to all subscribers, to all in the same order.

        Events that another thread or a subscriber publishes meanwhile are distributed by the first
        thread, after the earlier ones.
        """
        with self._lock:
            self._waiting.extend(events)
            if self._distributing:
                return
            self._distributing = True
        try:
            self._distribute()
        except BaseException:  # an interrupt: the next call of publish continues
            with self._lock:
                self._distributing = False
            raise

    def _distribute(self) -> None:
        while True:
            with self._lock:
                if not self._waiting:
                    self._distributing = False
                    return
                event = self._waiting.popleft()
                subscriptions = self._subscriptions
            for subscription in subscriptions:
                if subscription.wants(event):
                    try:
                        subscription.callback(event)
                    except Exception:  # reported; the other subscribers still get the event
                        logger.exception("a subscriber failed at: %s", event)

    def _cancel(self, subscription: Subscription) -> None:
        with self._lock:
            self._subscriptions = tuple(s for s in self._subscriptions if s is not subscription)
