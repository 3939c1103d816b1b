"""The change feed of a map: a notification wakes, the table `change` says what changed.

Why: docs/decisions/a_reader_s_cursor_is_on_disk_before_it_is_used.md
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import psycopg
from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import DBAPIError

from semmap.database.maps import driver_of, pick_map, see_map
from semmap.database.notifications import SERVER_AWAY, notifications
from semmap.query.entity_query import SETTLE
from semmap.query.snapshot import Snapshot

CHANNEL = "semmap"
"""Where each transaction that changes a map announces it."""

FIELDS = "semmap_fields"
"""Where a service announces that what its fields state has changed: by sources, or as it has read a
change of the map."""


@dataclass(frozen=True)
class Look:
    """One state of a map, and what changed since the last one that was taken in.

    `changed` has ids of entities, deleted ones included; None where the whole map is to be read: at
    the first look, or where changes since the last one are not kept. `rows` are those of the
    statement that was sent along; the transaction of `seen` is committed at the end of the look.
    """

    seen: Snapshot
    changed: frozenset[int] | None
    cursor: str  # where the state lies in the history
    moment: datetime  # when the transaction began
    rows: tuple[tuple[Any, ...], ...] = ()


class ChangeFeed:
    """Follows a map, for one thread at a time: the current map, unless a name is given.

    A `durable` feed makes each cursor survive a crash of the server, at the price of a write to its
    disk; else it forgets the cursor when the server was away: a server that crashed assigns
    transaction numbers again that the feed has seen. With `one_connection`, looks use a private
    connection, which `close` closes.
    """

    def __init__(
        self,
        engine: Engine,
        map_name: str | None = None,
        *,
        durable: bool = True,
        one_connection: bool = False,
    ) -> None:
        self.map_name = map_name
        self.cursor: str | None = None
        self._engine = engine
        self._durable = durable
        self._one_connection = one_connection
        self._own: tuple[Connection, psycopg.Connection[Any]] | None = None

    def close(self) -> None:
        """Close the connection of the looks, if they have a private one."""
        own, self._own = self._own, None
        if own is not None:
            connection, driver = own
            with suppress(DBAPIError):  # the server may be away
                connection.close()
            driver.close()

    @contextmanager
    def snapshot(self) -> Iterator[Snapshot]:
        """One state of the map, whatever changed."""
        with _one_state(self._engine) as connection:
            self.map_name = see_map(connection, self.map_name)
            yield Snapshot.of(connection, self.map_name)

    @contextmanager
    def look(
        self, *, entities: bool = True, also: tuple[str, Mapping[str, Any]] | None = None
    ) -> Iterator[Look]:
        """Look at what changed, with `entities`, and send a statement with its values along.

        Pass the look to `take_in` when it is processed: until then the next sees the same changes.
        A LookupError names a map that is not there.
        """
        try:
            with self._connected() as (connection, driver):
                connection.begin()
                if self.map_name is None:
                    self.map_name = pick_map(connection)
                with driver.pipeline():  # one message
                    see_map(driver, self.map_name)
                    state = driver.execute("SELECT change_cursor(), now()")
                    asked = also and driver.execute(also[0].encode(), also[1], prepare=True)
                seen = Snapshot.of(connection, self.map_name)
                ((now, moment),) = state.fetchall()
                rows = tuple(asked.fetchall()) if asked else ()
                changed = None
                if self.cursor is not None and entities:
                    changed = changed_since(seen, self.cursor)
                yield Look(seen, changed, now, moment, rows)
                if self._durable:
                    driver.execute(SETTLE)
                connection.commit()
        except DBAPIError as error:
            if error.connection_invalidated:
                self._server_was_away()
            raise
        except psycopg.OperationalError:
            self._server_was_away()
            raise

    @contextmanager
    def _connected(self) -> Iterator[tuple[Connection, psycopg.Connection[Any]]]:
        """A connection whose transactions see one state of the database."""
        if not self._one_connection:
            with _one_state(self._engine) as connection:
                yield connection, driver_of(connection)
            return
        if self._own is None:
            connection = self._engine.connect()
            connection.execution_options(isolation_level="REPEATABLE READ")
            self._own = connection, driver_of(connection)
            connection.detach()  # the pool lends others
        try:
            yield self._own
        except BaseException:
            self.close()
            raise

    def take_in(self, look: Look) -> None:
        """The follower has what a look showed: the next one begins there."""
        self.cursor = look.cursor

    def follow(
        self,
        stop: threading.Event,
        wake: Callable[[tuple[str, ...] | None], None],
        *,
        patience: float = 0.2,
        fields: bool = False,
    ) -> None:
        """Call `wake` whenever there may be something new, until `stop` is set.

        It gets the payloads that were sent, none every `patience` seconds, and None where anything
        may have changed; where it loses the server, it is called again. With `fields`, it is also
        called when fields have changed.
        """
        again = False
        channels = (CHANNEL, FIELDS) if fields else (CHANNEL,)
        with closing(notifications(self._engine, channels, stop, patience=patience)) as sent:
            for payloads in sent:
                try:
                    wake(None if again else payloads)
                    again = False
                except SERVER_AWAY:
                    again = True
                    self._server_was_away()
                    stop.wait(patience)

    def _server_was_away(self) -> None:
        if not self._durable:
            self.cursor = None


def announce_fields(engine: Engine, map_name: str) -> None:
    """Tell the followers of a map that what fields state has changed."""
    with engine.begin() as connection:
        connection.execute(
            text("SELECT pg_notify(:channel, :message)"),
            {"channel": FIELDS, "message": json.dumps({"fields": map_name})},
        )


def shows_fields(payload: str, map_name: str | None) -> bool:
    """Return whether a payload says that fields of a map have changed.

    >>> shows_fields('{"fields": "house"}', "house"), shows_fields('{"moved": [7]}', "house")
    (True, False)
    """
    with suppress(ValueError, RecursionError):
        message = json.loads(payload)
        return isinstance(message, dict) and "fields" in message and message["fields"] == map_name
    return False


def changed_since(seen: Snapshot, since: str) -> frozenset[int] | None:
    """The entities of the map that changed after a cursor, deleted ones included.

    Those of which only a belief, a statement, an inference or a link changed are left out: their
    geometry and types are as before. None where the changes are not all kept.
    """
    row = seen.session.execute(
        "SELECT CASE WHEN reaches_back(%(since)s) THEN ARRAY ("
        "SELECT unnest(entities) FROM changes_since(%(since)s) WHERE map_id = current_map() "
        "AND what NOT IN ('belief', 'statement', 'inferred', 'linked')) END",
        {"since": since},
    ).fetchone()
    return None if row is None or row[0] is None else frozenset(row[0])


@contextmanager
def _one_state(engine: Engine) -> Iterator[Connection]:
    """A transaction that sees one state of the database throughout."""
    with engine.connect().execution_options(isolation_level="REPEATABLE READ") as connection:
        yield connection
