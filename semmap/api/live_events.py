"""What is followed while a program runs: events in a loop, or given to a function."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack
from itertools import takewhile
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

if TYPE_CHECKING:
    from semmap.api.kept_fields import Note
    from semmap.fields.service.client import ServiceConnection
    from semmap.query.map_handle import MapSource

Item = TypeVar("Item")
Event = dict[str, Any]
Callback = Callable[[Event], Any] | None


class LiveEvents(Generic[Item]):
    """Events, in a loop over this; use it in a ``with`` statement, or close it.

    `count` says how much is true already, which is no event. It is closed after `seconds`; None:
    never. A `callback` gets the events in a thread of this; a loop then has nothing.
    """

    def __init__(
        self,
        count: int,
        events: Iterable[Item],
        close: Callable[[], Any],
        *,
        seconds: float | None = None,
        callback: Callable[[Item], Any] | None = None,
    ) -> None:
        self.count = count
        self._events: Iterable[Item] = events if callback is None else ()
        self._close = close
        self._closed = threading.Event()
        self._timer = timer(seconds, self.close)
        if callback is not None:

            def call() -> None:
                for event in events:
                    callback(event)

            threading.Thread(target=call, daemon=True).start()

    def __iter__(self) -> Iterator[Item]:
        """Iterate over events as they come, until this is closed."""
        return iter(self._events)

    def close(self) -> None:
        """End it, and loops over it."""
        if not self._closed.is_set():
            self._closed.set()
            self._timer.cancel()
            self._close()

    def __enter__(self) -> Self:
        """Return this; the end of the ``with`` block closes it."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close this."""
        self.close()


def timer(seconds: float | None, then: Callable[[], Any]) -> threading.Timer:
    """A timer that calls a function after some seconds, unless it is cancelled; never for None."""
    found = threading.Timer(seconds or 0, then)
    found.daemon = True
    if seconds is not None:
        found.start()
    return found


# --- relations between entities


def watch_service(
    service: AbstractContextManager[ServiceConnection | None],
    seconds: float | None,
    callback: Callback,
    note: Note,
) -> LiveEvents[Event] | None:
    """Follow what a service reports; None if none is running."""
    with ExitStack() as stack:
        found = stack.enter_context(service)
        if found is None:
            return None
        note(f"reported by the service of {found.map_name}")
        found.send("watch", seconds=seconds)
        replies = found.replies()
        count = 0
        for event in replies:
            if event.get("held") is False:
                break
            count += 1
        opened = stack.pop_all()

    events = takewhile(lambda event: "over" not in event, replies)
    return LiveEvents(count, events, opened.close, callback=callback)


def watch_map(
    map: MapSource,
    voxel_size: float,
    note: Note,
    seconds: float | None,
    save_every: float | None,
    callback: Callback,
) -> LiveEvents[Event]:
    """Follow the map in a thread, and publish what begins and ends."""
    from semmap.api.kept_fields import resumed_mirror
    from semmap.fields.relations.tracker import RelationTracker
    from semmap.fields.store.event_channel import EventPublisher, as_json

    stop = threading.Event()
    mirror = resumed_mirror(map, voxel_size, note)
    tracker = RelationTracker.of(mirror)
    tracker.update(mirror.regions.entities())
    publisher = EventPublisher(map.engine)
    waiting: queue.SimpleQueue[Event | Exception | None] = queue.SimpleQueue()

    def on_change(changed: set[int]) -> None:
        events = tracker.update(changed)
        publisher.publish(events)
        for event in events:
            waiting.put(as_json(event))

    def follow() -> None:
        try:
            mirror.follow(stop, on_change, save_every=save_every)
        except Exception as error:  # nothing else reports what ends a thread
            waiting.put(error)
        waiting.put(None)

    def events() -> Iterator[Event]:
        while (event := waiting.get()) is not None:
            if isinstance(event, Exception):
                raise event
            yield event

    thread = threading.Thread(target=follow, daemon=True)

    def close() -> None:
        stop.set()
        if thread is not threading.current_thread():
            thread.join()

    count = len(tracker.holding())
    thread.start()
    return LiveEvents(count, events(), close, seconds=seconds, callback=callback)
