"""Events of relations on the channel `semmap_events` of the database, as JSON (docs/fields.md)."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Hashable, Iterable, Iterator
from datetime import datetime

import psycopg
from sqlalchemy import Engine, text
from sqlalchemy.exc import DBAPIError

from semmap.fields.relations.facts import RelationEvent

CHANNEL = "semmap_events"

ServerError = DBAPIError
"""What a statement raises while the server is away."""

LONGEST = 7999
"""The most bytes of a message of NOTIFY."""


class EventPublisher:
    """Sends events to all listeners on the channel of a database; for one thread."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._number = 0
        self._waiting: deque[str] = deque()

    def publish(self, events: Iterable[RelationEvent]) -> None:
        """Send events, in one transaction, after those that wait since the database was away.

        Raises TypeError or ValueError, and sends none: a subject or object is neither a text nor an
        integer, or too long. Give the tracker names of entities.
        """
        messages = [
            _message(number, event) for number, event in enumerate(events, self._number + 1)
        ]
        self._number += len(messages)
        self._waiting += messages
        if not self._waiting:
            return
        # A transaction sends equal messages only once; the numbers make all messages different.
        with self._engine.begin() as connection:
            connection.execute(
                text(
                    "SELECT count(pg_notify(:channel, message)) "
                    "FROM unnest(CAST(:messages AS text[])) message"
                ),
                {"channel": CHANNEL, "messages": [*self._waiting]},
            )
        self._waiting.clear()

    def __call__(self, event: RelationEvent) -> None:
        """Send one event, so that a publisher can be a callback of an `EventBus`."""
        self.publish([event])


class EventListener:
    """Receives the events that are published from now on, by a connection until it is closed."""

    def __init__(self, engine: Engine) -> None:
        self._connection = engine.connect()
        driver = self._connection.connection.driver_connection
        assert isinstance(driver, psycopg.Connection)
        self._driver = driver
        self._driver.autocommit = True
        self._driver.execute(f"LISTEN {CHANNEL}")

    def events(
        self, timeout: float | None = None, count: int | None = None
    ) -> Iterator[RelationEvent]:
        """Yield events as they arrive; other messages on the channel are ignored.

        It ends after `timeout` seconds without a message, or `count` messages, or a few more.
        """
        for notice in self._driver.notifies(timeout=timeout, stop_after=count):
            event = _event(notice.payload)
            if event is not None:
                yield event

    def close(self) -> None:
        """Stop listening."""
        if not self._driver.closed:
            self._driver.execute(f"UNLISTEN {CHANNEL}")
            self._driver.autocommit = False
        self._connection.close()

    def __enter__(self) -> EventListener:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def as_json(event: RelationEvent) -> dict[str, str | int]:
    """Return an event for `json.dumps`; TypeError for names that are neither text nor integer."""
    return {
        "event": "begin" if event.began else "end",
        "relation": event.relation,
        "subject": _plain(event.subject),
        "object": _plain(event.object),
        "time": event.time.isoformat(),
    }


def _message(number: int, event: RelationEvent) -> str:
    message = json.dumps({"number": number, **as_json(event)}, ensure_ascii=False)
    if len(message.encode()) > LONGEST:
        raise ValueError(
            f"the event is longer than {LONGEST} bytes: give its subject and object shorter names"
        )
    if "\\u0000" in message:
        raise ValueError("a name contains NUL, which messages cannot contain: give another name")
    return message


def _plain(entity: Hashable) -> str | int:
    if isinstance(entity, str) or (isinstance(entity, int) and not isinstance(entity, bool)):
        return entity
    raise TypeError(
        f"{entity!r} is neither a text nor an integer: give the tracker names of entities"
    )


def _event(payload: str) -> RelationEvent | None:
    """Return the event of a message; None for other messages."""
    try:
        message = json.loads(payload)
        return RelationEvent(
            str(message["relation"]),
            _plain(message["subject"]),
            _plain(message["object"]),
            began={"begin": True, "end": False}[message["event"]],
            time=datetime.fromisoformat(message["time"]),
        )
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
