"""The relations between entities that begin and end: of the service, or of the map alone."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack
from itertools import takewhile
from typing import TYPE_CHECKING, Any

from semmap.api.live_events import LiveEvents

if TYPE_CHECKING:
    from semmap.api.kept_fields import Note
    from semmap.fields.service.client import ServiceConnection
    from semmap.query.map_handle import MapSource

Event = dict[str, Any]
Callback = Callable[[Event], Any] | None


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
    names: Mapping[Any, Any] = mirror.names
    tracker = RelationTracker(mirror.regions, names=names, views=mirror.views, spaces=mirror.spaces)
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
