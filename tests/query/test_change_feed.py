"""A cursor skips no change, and says when what follows it is not kept any more."""

from __future__ import annotations

import json
import queue
import threading
from typing import Any

import psycopg
import pytest
from sqlalchemy import Connection, Engine, text

from semmap.query.change_feed import ChangeFeed
from semmap.query.entity_query import changes_since


def write(engine: Engine, number: int, name: str) -> None:
    """Some transactions of one to three statements each, some of them undone."""
    with engine.connect() as connection:
        for i in range(number):
            for j in range(1 + i % 3):
                connection.execute(
                    text(
                        "INSERT INTO entity (map_id, kind, name) "
                        "SELECT id, 'object', :name FROM map"
                    ),
                    {"name": f"{name}{i}.{j}"},
                )
            if i % 5 == 4:
                connection.rollback()
            connection.commit()


def driver(connection: Connection) -> psycopg.Connection[Any]:
    return connection.connection.driver_connection  # type: ignore[return-value]


def test_a_poller_beside_writers_misses_nothing(engine: Engine) -> None:
    with engine.begin() as connection:
        connection.execute(text("INSERT INTO map (name) VALUES ('m')"))
    writers = [threading.Thread(target=write, args=(engine, 150, name)) for name in "ab"]
    for writer in writers:
        writer.start()
    seen: list[int] = []
    cursor = None
    while True:
        alive = any(writer.is_alive() for writer in writers)
        with engine.begin() as connection:
            cursor, rows = changes_since(driver(connection), cursor)
        seen += [row["id"] for row in rows]
        if not alive:
            break
    with engine.connect() as connection:
        assert sorted(seen) == sorted(connection.execute(text("SELECT id FROM change")).scalars())


def test_a_cursor_of_a_transaction_that_wrote_is_before_its_changes(engine: Engine) -> None:
    added = "INSERT INTO entity (map_id, kind, name) SELECT id, 'object', :name FROM map"
    with engine.begin() as connection:
        connection.execute(text("INSERT INTO map (name) VALUES ('m')"))
    with engine.connect() as writer, engine.connect() as reader:
        writer.execute(text(added), {"name": "a"})
        write(engine, 1, "other")
        cursors = [changes_since(driver(writer), None)[0]]
        cursors += writer.execute(text("SELECT cursor FROM changes_since(NULL) LIMIT 1")).scalars()
        writer.execute(text(added), {"name": "b"})
        writer.commit()
        for cursor in cursors:
            _, rows = changes_since(driver(reader), cursor)
            assert [len(row["entities"]) for row in rows] == [1, 1]


def test_a_cursor_before_pruned_changes_is_refused(engine: Engine) -> None:
    with engine.begin() as connection:
        connection.execute(text("INSERT INTO map (name) VALUES ('m')"))
    write(engine, 2, "old")
    with engine.begin() as connection:
        before, _ = changes_since(driver(connection), None)
    write(engine, 1, "older than the retention")
    with engine.begin() as connection:
        after, rows = changes_since(driver(connection), before)
        assert [row["what"] for row in rows] == ["added"]
        connection.execute(text("UPDATE change SET at = at - interval '8 days'"))
        assert connection.execute(text("SELECT prune_changes()")).scalar_one() > 0
    write(engine, 1, "new")
    with engine.begin() as connection:
        _, rows = changes_since(driver(connection), after)
        assert [row["what"] for row in rows] == ["added"]
    with (
        engine.begin() as connection,
        pytest.raises(psycopg.Error, match=r"the changes after the cursor .* are not all kept"),
    ):
        changes_since(driver(connection), before)


def test_changes_are_pruned_by_whoever_writes(engine: Engine) -> None:
    with engine.begin() as connection:
        connection.execute(text("INSERT INTO map (name) VALUES ('m')"))
    write(engine, 10, "old")
    with engine.begin() as connection:
        connection.execute(text("UPDATE change SET at = at - interval '8 days'"))
        connection.execute(text("SELECT setval(pg_get_serial_sequence('change', 'id'), 999)"))
    write(engine, 1, "new")
    with engine.connect() as connection:
        assert connection.execute(text("SELECT id FROM change")).scalars().all() == [1000]


def test_a_look_that_is_not_taken_in_is_seen_again(engine: Engine) -> None:
    with engine.begin() as connection:
        connection.execute(text("INSERT INTO map (name) VALUES ('m')"))
    feed = ChangeFeed(engine)
    with feed.look() as look:
        assert look.changed is None
    feed.take_in(look)
    write(engine, 1, "a")
    for _ in range(2):
        with feed.look() as look:
            assert look.changed is not None
            assert len(look.changed) == 1
    feed.take_in(look)
    with feed.look() as look:
        assert look.changed == frozenset()


def test_a_follower_is_woken_and_survives_a_lost_connection(engine: Engine) -> None:
    with engine.begin() as connection:
        connection.execute(text("INSERT INTO map (name) VALUES ('m')"))
    woken: queue.Queue[tuple[str, ...] | None] = queue.Queue()
    stop = threading.Event()
    lose = threading.Event()

    def wake(payloads: tuple[str, ...] | None) -> None:
        if payloads is None or payloads:
            woken.put(payloads)
        if lose.is_set():
            lose.clear()
            with engine.connect() as connection:
                connection.execute(text("SELECT pg_terminate_backend(pg_backend_pid())"))

    feed = ChangeFeed(engine, durable=False)
    follower = threading.Thread(target=feed.follow, args=(stop, wake), kwargs={"patience": 0.05})
    follower.start()
    try:
        assert woken.get(timeout=10) is None
        write(engine, 1, "a")
        (payload,) = woken.get(timeout=10) or ()
        assert json.loads(payload)["maps"] == ["m"]
        feed.cursor = "1:1:"
        lose.set()
        assert woken.get(timeout=10) is None, "what it did when the connection was lost, it repeats"
        assert feed.cursor is None
        with engine.begin() as connection:
            listening = "SELECT pid FROM pg_stat_activity WHERE query LIKE 'LISTEN%'"
            for pid in connection.execute(text(listening)).scalars().all():
                connection.execute(text("SELECT pg_terminate_backend(:pid)"), {"pid": pid})
        assert woken.get(timeout=10) is None, "it listens again"
        write(engine, 1, "b")
        assert woken.get(timeout=10)
    finally:
        stop.set()
        follower.join(10)
    assert not follower.is_alive()
