"""Each subscriber hears each event once and in order; the channel of a real database, too."""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Hashable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import psycopg
import pytest
from sqlalchemy import Engine, create_engine, text
from sqlalchemy.exc import DBAPIError

from semmap.fields import Cone
from semmap.fields.store.event_channel import CHANNEL, Announcer, Listener
from semmap.fields.relations.events import Events, Stream
from semmap.fields.store.voxel_mirror import Mirror
from semmap.fields.relations.relations import Event, Fact, Relations
from semmap.ingest.importer import import_file
from tests.fields.store.test_voxel_mirror import boxes, change, number

START = datetime(2026, 1, 1, 12, tzinfo=UTC)


def numbered(count: int, relation: str = "sees", thing: Hashable = "human1") -> list[Event]:
    return [
        Event(relation, thing, f"book_{i // 2}", i % 2 == 0, START + timedelta(seconds=i))
        for i in range(count)
    ]


def test_each_hears_all_once_and_in_order() -> None:
    hub, first, second = Events(), list[Event](), list[Event]()
    hub.subscribe(first.append)
    sent = numbered(10)
    hub.publish(sent[:4])
    with hub.subscribe(second.append):
        hub.publish(sent[4:8])
    hub.publish(sent[8:])
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
def test_limits(limits: dict[str, str], count: int) -> None:
    hub, heard = Events(), list[Event]()
    hub.subscribe(heard.append, **limits)
    hub.publish(numbered(30) + numbered(10, "on") + numbered(20, "on", 0))
    assert len(heard) == count


def test_one_that_fails_stops_nobody(caplog: pytest.LogCaptureFixture) -> None:
    hub, heard = Events(), list[Event]()

    def fail(event: Event) -> None:
        raise RuntimeError("no ears")

    hub.subscribe(fail)
    hub.subscribe(heard.append)
    with caplog.at_level(logging.ERROR):
        hub.publish(numbered(3))
    assert heard == numbered(3)
    assert [r.getMessage() for r in caplog.records] == [
        f"a subscriber failed at: {event}" for event in numbered(3)
    ]
    assert all(r.exc_info and "no ears" in str(r.exc_info[1]) for r in caplog.records)


def test_an_interrupt_loses_nothing() -> None:
    hub, heard = Events(), list[Event]()
    hub.subscribe(heard.append)

    def interrupt(event: Event) -> None:
        if len(heard) == 2:
            raise KeyboardInterrupt

    hub.subscribe(interrupt)
    with pytest.raises(KeyboardInterrupt):
        hub.publish(numbered(5))
    assert heard == numbered(2)
    hub.publish([])
    assert heard == numbered(5)


def test_a_subscriber_publishes_and_cancels() -> None:
    """What it publishes comes after what was before it, to all in the same order."""
    hub, heard = Events(), list[Event]()
    follow_up = numbered(1, "on")

    def react(event: Event) -> None:
        if event.relation == "sees":
            reacting.cancel()
            hub.publish(follow_up)

    reacting = hub.subscribe(react)
    hub.subscribe(heard.append)
    hub.publish(numbered(3))
    assert heard == numbered(3) + follow_up


def test_many_threads() -> None:
    """Eight publish at once: two subscribers hear all of it, in one order."""
    hub, first = Events(), list[Event]()
    hub.subscribe(first.append)
    with hub.stream() as stream:
        threads = [
            threading.Thread(target=lambda i=i: [hub.publish([e]) for e in numbered(200, thing=i)])  # type: ignore[misc]
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
        assert [event for event in first if event.subject == i] == numbered(200, thing=i)


def test_a_stream_is_looped_over_in_its_thread() -> None:
    hub = Events()
    stream = hub.stream(relation="sees")
    heard: list[Event] = []
    thread = threading.Thread(target=lambda: heard.extend(stream))
    thread.start()
    hub.publish(numbered(50) + numbered(5, "on"))
    stream.close()
    thread.join(10)
    assert heard == numbered(50)
    hub.publish(numbered(1))
    assert stream.get() is None
    assert list(stream) == []
    assert isinstance(stream, Stream)
    with hub.stream() as other:
        assert other.get(timeout=0.01) is None
        hub.publish(numbered(1))
        assert other.get() == numbered(1)[0]


def test_on_the_channel(engine: Engine) -> None:
    """What is announced is heard once, in order, names of all kinds unharmed."""
    events = [
        *numbered(6),
        Event("in", 711, 'a "mug"\n\\ ☕ \'); DROP', True, START),
        Event("near", "x" * 7000, -1, False, START + timedelta(microseconds=1)),
    ]
    with Listener(engine) as one, Listener(engine) as other:
        announcer = Announcer(engine)
        announcer.announce(events[:5])
        announcer.announce([])
        for event in events[5:]:
            announcer(event)
        assert list(one.events(timeout=10, count=len(events))) == events
        assert list(other.events(timeout=10, count=len(events))) == events
        assert list(one.events(timeout=0.1)) == []
        announcer.announce(5 * events[:1])
        assert list(one.events(timeout=10, count=5)) == 5 * events[:1], "equal ones all come"


def test_the_message(engine: Engine) -> None:
    """As others read it, and what others send is passed over."""
    with Listener(engine) as ours, engine.connect() as connection:
        driver = connection.connection.driver_connection
        assert isinstance(driver, psycopg.Connection)
        driver.autocommit = True
        driver.execute("LISTEN semmap_events")
        Announcer(engine).announce(numbered(1))
        (notice,) = driver.notifies(timeout=10, stop_after=1)
        assert json.loads(notice.payload) == {
            "number": 1, "event": "begin", "relation": "sees", "subject": "human1",
            "object": "book_0", "time": "2026-01-01T12:00:00+00:00",
        }  # fmt: skip
        for other in ("", "[]", "3", '{"event": "x"}', '{"event": ["begin"]}', "{"):
            driver.execute("SELECT pg_notify(%s, %s)", (CHANNEL, other))
        assert list(ours.events(timeout=0.2)) == numbered(1)
        driver.execute("UNLISTEN *")
        driver.autocommit = False


def test_what_cannot_be_sent_sends_nothing(engine: Engine) -> None:
    announcer = Announcer(engine)
    with Listener(engine) as listener:
        for bad in (("a", 1), "x" * 8000, "a\0b", None, True):
            with pytest.raises((TypeError, ValueError), match="name"):
                announcer.announce([*numbered(2), Event("on", bad, "table", True, START)])
        announcer.announce(numbered(1))
        assert list(listener.events(timeout=0.2)) == numbered(1)


def test_the_database_was_away(engine: Engine) -> None:
    """What could not be sent comes with the next."""
    # One that does not look first whether its connection still is.
    frail = create_engine(engine.url, pool_pre_ping=False)
    announcer = Announcer(frail)
    with Listener(engine) as listener:
        announcer.announce(numbered(2))
        with frail.connect() as connection:
            backend = connection.execute(text("SELECT pg_backend_pid()")).scalar_one()
        change(engine, f"SELECT pg_terminate_backend({backend}, 10000)")
        with pytest.raises(DBAPIError):
            announcer.announce(numbered(4)[2:])
        announcer.announce(numbered(6)[4:])
        assert list(listener.events(timeout=1, count=6)) == numbered(6)
    frail.dispose()


def test_a_listener_that_is_cut_off(engine: Engine) -> None:
    """It says so, and another one hears."""
    listener = Listener(engine)
    change(
        engine,
        "SELECT pg_terminate_backend(pid, 10000) FROM pg_stat_activity "
        "WHERE datname = current_database() AND query LIKE 'LISTEN%'",
    )
    with pytest.raises(psycopg.OperationalError):
        list(listener.events(timeout=10))
    listener.close()
    with Listener(engine) as another:
        Announcer(engine).announce(numbered(1))
        assert list(another.events(timeout=10, count=1)) == numbered(1)


def test_from_the_database_to_the_channel(engine: Engine, tmp_path: Path) -> None:
    """A cube is put onto another in the map: human1 begins to see it, once, and its end, once."""
    world = boxes(tmp_path, a=(0, 0, 0.2), b=(3, 0, 0.2))
    import_file(engine, world, map_name="scene")
    mirror = Mirror(engine, "scene", 0.1)
    names: dict[Hashable, Hashable] = {}
    relations = Relations(mirror.regions, views={"fov": "human1"}, names=names)
    hub, heard, announcer = Events(), list[Event](), Announcer(engine)
    hub.subscribe(heard.append, relation="sees")

    def take_in(changed: set[int]) -> None:
        names.update(mirror.names)
        events = relations.update(changed)
        hub.publish(events)
        announcer.announce(events)

    with Listener(engine) as listener:
        take_in(mirror.catch_up())
        mirror.regions.insert("fov", Cone((3, 3, 0.6), (0, -1, 0), 0.5, 5.0))
        hub.publish(relations.update(["fov"]))
        assert [str(event) for event in heard] == ["human1 sees b begins"]
        change(engine, "SELECT move_to(entity_id('a'), 3.0, 0.0, 0.6, 0.0)")
        assert mirror.catch_up() == {number(engine, "a")}
        take_in({number(engine, "a")})
        assert Fact("on", "a", "b") in relations.holding()
        change(engine, "DELETE FROM entity WHERE name = 'a'")
        take_in(mirror.catch_up())
        assert [str(event) for event in heard] == [
            "human1 sees b begins", "human1 sees a begins", "human1 sees a ends",
        ]  # fmt: skip
        told = [str(event) for event in listener.events(timeout=0.3)]
        assert [each for each in told if "sees" in each] == [str(event) for event in heard[1:]]
        assert told.count("a on b begins") == told.count("a on b ends") == 1
