"""Each subscriber gets each event once and in order."""

from __future__ import annotations

import logging
import threading
from collections.abc import Hashable
from datetime import UTC, datetime, timedelta

import pytest

from semmap.fields.relations.event_bus import EventBus, EventStream
from semmap.fields.relations.facts import RelationEvent

START = datetime(2026, 1, 1, 12, tzinfo=UTC)


def numbered(
    count: int, relation: str = "sees", subject: Hashable = "human1"
) -> list[RelationEvent]:
    return [
        RelationEvent(relation, subject, f"book_{i // 2}", i % 2 == 0, START + timedelta(seconds=i))
        for i in range(count)
    ]


def test_subscribers_get_each_event_once_and_in_order() -> None:
    bus, first, second = EventBus(), list[RelationEvent](), list[RelationEvent]()
    bus.subscribe(first.append)
    sent = numbered(10)
    bus.publish(sent[:4])
    with bus.subscribe(second.append):
        bus.publish(sent[4:8])
    bus.publish(sent[8:])
    assert first == sent
    assert second == sent[4:8]


@pytest.mark.parametrize(
    ("limits", "count"),
    [
        ({}, 60),
        ({"relation": "sees"}, 30),
        ({"relation": "under"}, 0),
        ({"subject": "human1"}, 40),
        ({"subject": 0}, 20),
        ({"object": "book_3"}, 6),
        ({"relation": "sees", "subject": 0, "object": "book_3"}, 0),
        ({"relation": "on", "subject": 0, "object": "book_3"}, 2),
    ],
)
def test_subscriptions_limit_events(limits: dict[str, str], count: int) -> None:
    bus, heard = EventBus(), list[RelationEvent]()
    bus.subscribe(heard.append, **limits)
    bus.publish(numbered(30) + numbered(10, "on") + numbered(20, "on", 0))
    assert len(heard) == count


def test_a_failing_subscriber_does_not_stop_others(caplog: pytest.LogCaptureFixture) -> None:
    bus, heard = EventBus(), list[RelationEvent]()

    def fail(event: RelationEvent) -> None:
        raise RuntimeError("no ears")

    bus.subscribe(fail)
    bus.subscribe(heard.append)
    with caplog.at_level(logging.ERROR):
        bus.publish(numbered(3))
    assert heard == numbered(3)
    assert [r.getMessage() for r in caplog.records] == [
        f"a subscriber failed at: {event}" for event in numbered(3)
    ]
    assert all(r.exc_info and "no ears" in str(r.exc_info[1]) for r in caplog.records)


def test_no_event_is_lost_by_an_interrupt() -> None:
    bus, heard = EventBus(), list[RelationEvent]()
    bus.subscribe(heard.append)

    def interrupt(event: RelationEvent) -> None:
        if len(heard) == 2:
            raise KeyboardInterrupt

    bus.subscribe(interrupt)
    with pytest.raises(KeyboardInterrupt):
        bus.publish(numbered(5))
    assert heard == numbered(2)
    bus.publish([])
    assert heard == numbered(5)


def test_a_subscriber_may_publish_and_cancel() -> None:
    """Its events come after the earlier ones, to all in the same order."""
    bus, heard = EventBus(), list[RelationEvent]()
    follow_up = numbered(1, "on")

    def react(event: RelationEvent) -> None:
        if event.relation == "sees":
            reacting.cancel()
            bus.publish(follow_up)

    reacting = bus.subscribe(react)
    bus.subscribe(heard.append)
    bus.publish(numbered(3))
    assert heard == numbered(3) + follow_up


def test_threads_publish_in_one_order() -> None:
    """Eight threads publish: two subscribers get all events in one order."""
    bus, first = EventBus(), list[RelationEvent]()
    bus.subscribe(first.append)
    with bus.stream() as stream:
        threads = [
            threading.Thread(
                target=lambda i=i: [bus.publish([e]) for e in numbered(200, subject=i)]
            )  # type: ignore[misc]
            for i in range(8)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    second = list(stream)
    assert len(first) == 1600
    assert first == second
    for i in range(8):
        assert [event for event in first if event.subject == i] == numbered(200, subject=i)


def test_a_stream_in_another_thread() -> None:
    bus = EventBus()
    stream = bus.stream(relation="sees")
    heard: list[RelationEvent] = []
    thread = threading.Thread(target=lambda: heard.extend(stream))
    thread.start()
    bus.publish(numbered(50) + numbered(5, "on"))
    stream.close()
    thread.join(10)
    assert heard == numbered(50)
    bus.publish(numbered(1))
    assert stream.get() is None
    assert list(stream) == []
    assert isinstance(stream, EventStream)
    with bus.stream() as other:
        assert other.get(timeout=0.01) is None
        bus.publish(numbered(1))
        assert other.get() == numbered(1)[0]
