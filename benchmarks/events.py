"""A move of one of 10,000 objects until clients hear of it: by Python, and over HTTP."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from queue import SimpleQueue

import httpx
import numpy as np
import uvicorn

import semmap
from benchmarks.inventory import building, stored
from benchmarks.timing import Row, print_rows
from semmap.server.http_api import HttpApi

Follow = Callable[[semmap.Database, Callable[[str], None]], AbstractContextManager[None]]

MOVES = 200
LIMIT = 200
"""Milliseconds within which 99 of 100 moves are heard of."""


def measured() -> list[Row]:
    """The delay from before the call that moves to the client that has the event."""
    with stored(building()) as session:
        info = session.info
        url = f"postgresql:///{info.dbname}?host={info.host}&port={info.port}&user={info.user}"
        with semmap.connect(url) as db:
            return [
                _row("a client in Python (Map.subscribe)", db, subscribed),
                _row("a client of HTTP (server-sent events)", db, streamed),
            ]


@contextmanager
def subscribed(db: semmap.Database, hear: Callable[[str], None]) -> Iterator[None]:
    """Call with the name of each entity that changes."""
    with db.map("building").subscribe(lambda event: hear(event.name or "")):
        yield


@contextmanager
def streamed(db: semmap.Database, hear: Callable[[str], None]) -> Iterator[None]:
    """Call with the name of each entity that changes."""
    config = uvicorn.Config(
        HttpApi(db).app, port=0, log_level="warning", timeout_graceful_shutdown=1
    )
    server = uvicorn.Server(config)
    threads = [threading.Thread(target=server.run)]
    threads[0].start()
    while not server.started:
        time.sleep(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    ready = threading.Event()

    def follow() -> None:
        at = f"http://127.0.0.1:{port}/maps/building/events"
        with suppress(httpx.RemoteProtocolError), httpx.stream("GET", at, timeout=60) as events:
            for line in events.iter_lines():  # until the server stops
                ready.set()
                if line.startswith("data: "):
                    hear(json.loads(line[6:])["name"])

    threads.append(threading.Thread(target=follow))
    threads[1].start()
    ready.wait()
    yield
    server.should_exit = True
    for thread in threads:
        thread.join()


def _row(name: str, db: semmap.Database, by: Follow) -> Row:
    heard: SimpleQueue[str] = SimpleQueue()
    took = []
    with by(db, heard.put):
        for number in range(MOVES):
            cup = db.map("building")[f"cup{number % 100}_3_{number % 9}"]
            assert cup.pose is not None
            x, y, z = cup.pose[:3]
            began = time.perf_counter()
            cup.move_to(x + 0.01, y, z)
            while heard.get(timeout=20) != cup.name:
                pass
            took.append((time.perf_counter() - began) * 1e3)
    middle, late = np.percentile(took, (50, 99))
    shown = f"{middle:.1f} ms, 99 of 100 in {late:.1f} ms"
    return Row(name, shown, "", f"99 of 100 in {LIMIT} ms", bool(late <= LIMIT))


def main() -> None:
    """Print the table."""
    print_rows("A move of one of 10,000 objects, until it is heard of", measured())


if __name__ == "__main__":
    main()
