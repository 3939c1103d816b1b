"""Who hears of events in this process: each one once, in the order in which they came about."""

from __future__ import annotations

import logging
import queue
import threading
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass
from types import TracebackType

from semmap.fields.relations.relations import Event

__all__ = ["Events", "Stream", "Subscription"]

logger = logging.getLogger(__name__)

Callback = Callable[[Event], object]


@dataclass(frozen=True, eq=False)
class Subscription:
    """Who hears of which events, until it is cancelled.

    Attributes
    ----------
    callback : what is called with each event
    relation, subject, object : to which it is limited; None is any
    """

    callback: Callback
    relation: str | None
    subject: Hashable | None
    object: Hashable | None
    _events: Events

    def cancel(self) -> None:
        """Hear no more; what is being told at this moment may still come."""
        self._events._cancel(self)

    def wants(self, event: Event) -> bool:
        """Whether an event is of those that it is limited to."""
        return (
            self.relation in (None, event.relation)
            and self.subject in (None, event.subject)
            and self.object in (None, event.object)
        )

    def __enter__(self) -> Subscription:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.cancel()


class Stream:
    """Events as they come, to loop over; closed by the end of its `with` block or by `close`."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
        self._subscription: Subscription | None = None

    def __iter__(self) -> Iterator[Event]:
        """Those that came and those that will, until the stream is closed."""
        while (event := self._waiting.get()) is not None:
            yield event
        self._waiting.put(None)  # for the next loop, or another thread's

    def get(self, timeout: float | None = None) -> Event | None:
        """The next one; None if the stream is closed, or nothing came for `timeout` seconds."""
        try:
            event = self._waiting.get(timeout=timeout)
        except queue.Empty:
            return None
        if event is None:
            self._waiting.put(None)
        return event

    def close(self) -> None:
        """Hear no more; loops end once they had all that came before."""
        if self._subscription is not None:
            self._subscription.cancel()
        self._waiting.put(None)

    def __enter__(self) -> Stream:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


class Events:
    """Subscribers, and what they are told. May be used by several threads.

    Examples
    --------
    >>> from datetime import UTC, datetime
    >>> events = Events()
    >>> with events.subscribe(print, relation="sees", object="book_326"):
    ...     for began in (True, False):
    ...         events.publish([Event("sees", "human1", "book_326", began, datetime.now(UTC))])
    human1 sees book_326 begins
    human1 sees book_326 ends
    """

    def __init__(self) -> None:
        self._subscriptions: tuple[Subscription, ...] = ()
        self._waiting: deque[Event] = deque()
        self._telling = False
        self._lock = threading.Lock()

    def subscribe(
        self,
        callback: Callback,
        *,
        relation: str | None = None,
        subject: Hashable | None = None,
        object: Hashable | None = None,
    ) -> Subscription:
        """Call something with each event, or with those of one relation, subject or object.

        It is called in the thread that publishes. What it raises is logged, and the next one comes
        all the same.
        """
        subscription = Subscription(callback, relation, subject, object, self)
        with self._lock:
            self._subscriptions = (*self._subscriptions, subscription)
        return subscription

    def stream(
        self,
        *,
        relation: str | None = None,
        subject: Hashable | None = None,
        object: Hashable | None = None,
    ) -> Stream:
        """The events from now on, to loop over in a thread of one's own."""
        stream = Stream()
        stream._subscription = self.subscribe(
            stream._waiting.put, relation=relation, subject=subject, object=object
        )
        return stream

    def publish(self, events: Iterable[Event]) -> None:
        """Tell all that subscribed.

        All hear the same order. While one thread tells, what others publish (or a subscriber
        itself) is told by that thread, after what came before.
        """
        with self._lock:
            self._waiting.extend(events)
            if self._telling:
                return
            self._telling = True
        try:
            self._tell()
        except BaseException:  # an interrupt: the next to publish goes on
            with self._lock:
                self._telling = False
            raise

    def _tell(self) -> None:
        while True:
            with self._lock:
                if not self._waiting:
                    self._telling = False
                    return
                event = self._waiting.popleft()
                subscriptions = self._subscriptions
            for subscription in subscriptions:
                if subscription.wants(event):
                    try:
                        subscription.callback(event)
                    except Exception:
                        logger.exception("a subscriber failed at: %s", event)

    def _cancel(self, subscription: Subscription) -> None:
        with self._lock:
            self._subscriptions = tuple(s for s in self._subscriptions if s is not subscription)
