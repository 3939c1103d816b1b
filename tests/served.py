"""The maps of a database over HTTP, on a free port of this machine."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import semmap
from semmap.server.http_api import HttpApi
from semmap.server.http_server import HttpServer


@contextmanager
def served(
    database: semmap.Database, tokens: Mapping[str, str] | None = None, **options: Any
) -> Iterator[str]:
    """The address of a server; `options` are those of `HttpApi`."""
    server = HttpServer(HttpApi(database, tokens, **options), "127.0.0.1", 0)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        yield f"http://127.0.0.1:{server.port}"
    finally:
        server.should_exit = True
        thread.join()
