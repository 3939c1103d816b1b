"""Clients that write unique ids and note which were acknowledged."""

from __future__ import annotations

import threading
import time
from itertools import pairwise
from typing import Self
from uuid import uuid4

import psycopg

TABLES = """
CREATE TABLE written (id text PRIMARY KEY);
CREATE TABLE total (writer int PRIMARY KEY, ids int NOT NULL);
INSERT INTO total SELECT writer, 0 FROM generate_series(0, 99) writer;
"""
WRITE = """
WITH first AS (INSERT INTO written VALUES (%(id)s) ON CONFLICT DO NOTHING RETURNING id)
UPDATE total SET ids = ids + (SELECT count(*) FROM first) WHERE writer = %(writer)s
"""
"""To repeat it has no effect: a writer repeats what was not acknowledged."""


PAUSE = 0.01
"""Seconds between two writes of a writer, so that writers do not take the servers' processors."""


class Writers:
    """Threads that write until the end of the block, each on the server that takes writes."""

    def __init__(self, url: str, threads: int = 4) -> None:
        self.url = url
        self.acknowledged: list[tuple[float, str]] = []
        self.notices = 0
        self._ending = threading.Event()
        self._threads = [
            threading.Thread(target=self._write, args=(writer,), daemon=True)
            for writer in range(threads)
        ]

    def __enter__(self) -> Self:
        self.begun = time.monotonic()
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ending.set()
        for thread in self._threads:
            thread.join(60)
            assert not thread.is_alive(), "a writer waits for more than a minute"

    def since(self, moment: float) -> int:
        """How many writes were acknowledged since a moment of `time.monotonic`."""
        return sum(at > moment for at, _ in self.acknowledged[-5000:])

    def longest_wait(self) -> float:
        """The longest time in seconds in which no write was acknowledged."""
        times = [self.begun, *sorted(at for at, _ in self.acknowledged)]
        return max(after - before for before, after in pairwise(times))

    def _write(self, writer: int) -> None:
        connection = None
        while not self._ending.is_set():
            row = {"id": f"{writer}-{uuid4()}", "writer": writer}
            while not self._ending.is_set():
                try:
                    if connection is None:
                        connection = psycopg.connect(self.url, connect_timeout=2)
                    if commits(connection, row):
                        self.acknowledged.append((time.monotonic(), row["id"]))
                        time.sleep(PAUSE)
                    else:
                        self.notices += 1
                    break
                except psycopg.Error:
                    if connection is not None:
                        connection.close()
                    connection = None
                    time.sleep(0.05)
        if connection is not None:
            connection.close()


def commits(connection: psycopg.Connection, row: dict[str, object]) -> bool:
    """Write a row; returns whether its commit is acknowledged for two servers.

    The server reports success for a commit whose wait was cancelled, and sends a notice.
    """
    unsure = []
    connection.add_notice_handler(
        note := lambda diagnostic: unsure.append(diagnostic.source_function)
    )
    try:
        with connection.transaction():
            connection.execute(WRITE, row)
    finally:
        connection.remove_notice_handler(note)
    return "SyncRepWaitForLSN" not in unsure


def lost_and_double(url: str, acknowledged: set[str]) -> tuple[int, int]:
    """How many acknowledged ids are not there, and how many effects are more than one for an id."""
    with psycopg.connect(url) as connection:
        there = {each for (each,) in connection.execute("SELECT id FROM written")}
        row = connection.execute("SELECT sum(ids) FROM total").fetchone()
    assert row is not None
    return len(acknowledged - there), abs(row[0] - len(there))
