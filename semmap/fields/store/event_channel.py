"""Events on the database's channel `semmap_events`: who announces them, and who listens.

A message is JSON: `{"number": 7, "event": "begin", "relation": "sees", "subject": "human1",
"object": "book_326", "time": "2026-01-01T12:00:00+00:00"}`; `event` is `begin` or `end`, `number`
counts what one announcer sent.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Hashable, Iterable, Iterator
from datetime import datetime
from types import TracebackType

import psycopg
from sqlalchemy import Engine, text

from semmap.fields.relations.relations import Event

__all__ = ["CHANNEL", "Announcer", "Listener", "as_json"]

CHANNEL = "semmap_events"

_LONGEST = 7999  # bytes that NOTIFY takes


class Announcer:
    """Sends events to all that listen on the database's channel; for one thread."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._number = 0
        self._waiting: deque[str] = deque()

    def announce(self, events: Iterable[Event]) -> None:
        """Send events, in one transaction.

        Where the database is away, they wait, and are sent before those of the next call; none is
        left out.

        Raises
        ------
        TypeError, ValueError
            A subject or object that is neither text nor a whole number, or too long to send;
            nothing is sent then. Give `Relations` the names that entities have.
        """
        messages = []
        for number, event in enumerate(events, self._number + 1):
            messages.append(_message(number, event))
        self._number += len(messages)
        self._waiting += messages
        if not self._waiting:
            return
        # A transaction sends what is equal once; numbers make all differ.
        with self._engine.begin() as connection:
            connection.execute(
                text(
                    "SELECT count(pg_notify(:channel, message)) "
                    "FROM unnest(CAST(:messages AS text[])) message"
                ),
                {"channel": CHANNEL, "messages": [*self._waiting]},
            )
        self._waiting.clear()

    def __call__(self, event: Event) -> None:
        """Send one, so that an announcer can be a subscriber itself."""
        self.announce([event])


class Listener:
    """Hears what is announced from now on.

    Examples
    --------
    >>> with Listener(engine) as listener:  # doctest: +SKIP
    ...     for event in listener.events():
    ...         print(event)
    """

    def __init__(self, engine: Engine) -> None:
        self._connection = engine.connect()
        driver = self._connection.connection.driver_connection
        assert isinstance(driver, psycopg.Connection)
        self._driver = driver
        self._driver.autocommit = True
        self._driver.execute(f"LISTEN {CHANNEL}")

    def events(self, timeout: float | None = None, count: int | None = None) -> Iterator[Event]:
        """Events as they come; what is no event of this kind is passed over.

        Parameters
        ----------
        timeout : seconds after which it ends if nothing comes; never if not given
        count : after how many messages it ends, or a few more
        """
        for notice in self._driver.notifies(timeout=timeout, stop_after=count):
            event = _event(notice.payload)
            if event is not None:
                yield event

    def close(self) -> None:
        """Hear no more."""
        if not self._driver.closed:
            self._driver.execute(f"UNLISTEN {CHANNEL}")
            self._driver.autocommit = False
        self._connection.close()

    def __enter__(self) -> Listener:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def as_json(event: Event) -> dict[str, str | int]:
    """An event as it is written in JSON."""
    return {
        "event": "begin" if event.began else "end",
        "relation": event.relation,
        "subject": _plain(event.subject),
        "object": _plain(event.object),
        "time": event.time.isoformat(),
    }


def _message(number: int, event: Event) -> str:
    message = json.dumps({"number": number, **as_json(event)}, ensure_ascii=False)
    if len(message.encode()) > _LONGEST:
        raise ValueError(
            f"the event is longer than {_LONGEST} bytes: give its subject and object shorter names"
        )
    if "\\u0000" in message:
        raise ValueError("a name has a NUL in it, which no message can: give another name")
    return message


def _plain(thing: Hashable) -> str | int:
    if isinstance(thing, str) or (isinstance(thing, int) and not isinstance(thing, bool)):
        return thing
    raise TypeError(f"{thing!r} is neither text nor a whole number: give Relations names of things")


def _event(payload: str) -> Event | None:
    """What a message says; None if it is another's."""
    try:
        said = json.loads(payload)
        began = {"begin": True, "end": False}[said["event"]]
        return Event(
            str(said["relation"]), _plain(said["subject"]), _plain(said["object"]), began,
            datetime.fromisoformat(said["time"]),
        )  # fmt: skip
    except (ValueError, KeyError, TypeError):
        return None
