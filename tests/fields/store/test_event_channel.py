"""Events on the channel of a real database."""

from __future__ import annotations

import json
from collections.abc import Hashable
from datetime import timedelta
from pathlib import Path

import psycopg
import pytest
from sqlalchemy import Engine, create_engine, text
from sqlalchemy.exc import DBAPIError

from semmap.fields import Cone
from semmap.fields.relations.event_bus import EventBus
from semmap.fields.relations.facts import RelationEvent, RelationFact
from semmap.fields.relations.tracker import RelationTracker
from semmap.fields.store.event_channel import CHANNEL, EventListener, EventPublisher
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.ingest.importer import import_file
from tests.fields.relations.test_event_bus import START, numbered
from tests.fields.store.test_voxel_mirror import boxes, change, number


def test_events_arrive_once_and_in_order(engine: Engine) -> None:
    """Names of all kinds are unchanged."""
    events = [
        *numbered(6),
        RelationEvent("in", 711, 'a "mug"\n\\ ☕ \'); DROP', True, START),
        RelationEvent("near", "x" * 7000, -1, False, START + timedelta(microseconds=1)),
    ]
    with EventListener(engine) as one, EventListener(engine) as other:
        publisher = EventPublisher(engine)
        publisher.publish(events[:5])
        publisher.publish([])
        for event in events[5:]:
            publisher(event)
        assert list(one.events(timeout=10, count=len(events))) == events
        assert list(other.events(timeout=10, count=len(events))) == events
        assert list(one.events(timeout=0.1)) == []
        publisher.publish(5 * events[:1])
        assert list(one.events(timeout=10, count=5)) == 5 * events[:1], "equal events all arrive"


def test_messages_are_json_and_others_are_ignored(engine: Engine) -> None:
    """Other programs may send anything on the channel, JSON of 7,999 brackets included."""
    with EventListener(engine) as ours, engine.connect() as connection:
        driver = connection.connection.driver_connection
        assert isinstance(driver, psycopg.Connection)
        driver.autocommit = True
        driver.execute("LISTEN semmap_events")
        EventPublisher(engine).publish(numbered(1))
        (notice,) = driver.notifies(timeout=10, stop_after=1)
        assert json.loads(notice.payload) == {
            "number": 1,
            "event": "begin",
            "relation": "sees",
            "subject": "human1",
            "object": "book_0",
            "time": "2026-01-01T12:00:00+00:00",
        }
        others = ("", "[]", "3", '{"event": "x"}', '{"event": ["begin"]}', "{", "[" * 7999)
        for other in others:
            driver.execute("SELECT pg_notify(%s, %s)", (CHANNEL, other))
        assert list(ours.events(timeout=0.2)) == numbered(1)
        driver.execute("UNLISTEN *")
        driver.autocommit = False


def test_a_wrong_event_prevents_the_whole_call(engine: Engine) -> None:
    publisher = EventPublisher(engine)
    with EventListener(engine) as listener:
        for bad in (("a", 1), "x" * 8000, "a\0b", None, True):
            with pytest.raises((TypeError, ValueError), match="name"):
                publisher.publish([*numbered(2), RelationEvent("on", bad, "table", True, START)])
        publisher.publish(numbered(1))
        assert list(listener.events(timeout=0.2)) == numbered(1)


def test_events_wait_while_the_database_is_away(engine: Engine) -> None:
    """The next call sends them first."""
    # An engine that does not check its connections first.
    frail = create_engine(engine.url, pool_pre_ping=False)
    publisher = EventPublisher(frail)
    with EventListener(engine) as listener:
        publisher.publish(numbered(2))
        with frail.connect() as connection:
            backend = connection.execute(text("SELECT pg_backend_pid()")).scalar_one()
        change(engine, f"SELECT pg_terminate_backend({backend}, 10000)")
        with pytest.raises(DBAPIError):
            publisher.publish(numbered(4)[2:])
        publisher.publish(numbered(6)[4:])
        assert list(listener.events(timeout=1, count=6)) == numbered(6)
    frail.dispose()


def test_a_listener_without_connection_raises(engine: Engine) -> None:
    """A new listener works."""
    listener = EventListener(engine)
    change(
        engine,
        "SELECT pg_terminate_backend(pid, 10000) FROM pg_stat_activity "
        "WHERE datname = current_database() AND query LIKE 'LISTEN%'",
    )
    with pytest.raises(psycopg.OperationalError):
        list(listener.events(timeout=10))
    listener.close()
    with EventListener(engine) as another:
        EventPublisher(engine).publish(numbered(1))
        assert list(another.events(timeout=10, count=1)) == numbered(1)


def test_from_the_database_to_the_channel(engine: Engine, tmp_path: Path) -> None:
    """A cube is put onto another one: human1 begins to see it once, and ends once."""
    world = boxes(tmp_path, a=(0, 0, 0.2), b=(3, 0, 0.2))
    import_file(engine, world, map_name="scene")
    mirror = VoxelMirror(engine, "scene", 0.1)
    names: dict[Hashable, Hashable] = {}
    tracker = RelationTracker(mirror.regions, views={"fov": "human1"}, names=names)
    bus, heard, publisher = EventBus(), list[RelationEvent](), EventPublisher(engine)
    bus.subscribe(heard.append, relation="sees")

    def on_change(changed: set[int]) -> None:
        names.update(mirror.names)
        events = tracker.update(changed)
        bus.publish(events)
        publisher.publish(events)

    with EventListener(engine) as listener:
        on_change(mirror.catch_up())
        mirror.regions.insert("fov", Cone((3, 3, 0.6), (0, -1, 0), 0.5, 5.0))
        bus.publish(tracker.update(["fov"]))
        assert [str(event) for event in heard] == ["human1 sees b begins"]
        change(engine, "SELECT move_to(entity_id('a'), 3.0, 0.0, 0.6, 0.0)")
        assert mirror.catch_up() == {number(engine, "a")}
        on_change({number(engine, "a")})
        assert RelationFact("on", "a", "b") in tracker.holding()
        change(engine, "DELETE FROM entity WHERE name = 'a'")
        on_change(mirror.catch_up())
        assert [str(event) for event in heard] == [
            "human1 sees b begins",
            "human1 sees a begins",
            "human1 sees a ends",
        ]
        received = [str(event) for event in listener.events(timeout=0.3)]
        assert [each for each in received if "sees" in each] == [str(event) for event in heard[1:]]
        assert received.count("a on b begins") == received.count("a on b ends") == 1
