"""Sessions that never finish their first line: others are served soon, and no server ends."""

from __future__ import annotations

import os
import resource
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import httpx

import semmap
from semmap.database import Cluster, DatabaseError
from semmap.fields.service.client import find_service, socket_of
from tests.soak.disk import COMMAND
from tests.soak.kills import OFFICE

NUMBER = 2000
FILES = 1024
"""Files that a server may open."""

SECONDS = {"embedded database": 10, "semmap fields serve": 10, "semmap serve": 30}
"""Within which a client is served that tries again."""


@contextmanager
def held(address: Any, number: int, sent: bytes) -> Iterator[None]:
    """Connections that send the beginning of a line."""
    family = socket.AF_INET if isinstance(address, tuple) else socket.AF_UNIX
    with ExitStack() as stack:
        for _ in range(number):
            one = stack.enter_context(socket.socket(family))
            one.connect(address)
            try:
                one.sendall(sent)
            except OSError:  # it was refused
                continue
        yield


@contextmanager
def command(cluster: Cluster, *arguments: str, files: int = FILES) -> Iterator[str]:
    """The first line of a command that serves, while it runs."""
    with subprocess.Popen(
        [*COMMAND, *arguments],
        env={**os.environ, "SEMMAP_DATA": str(cluster.home)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (files, files))
        assert process.stdout is not None
        try:
            yield process.stdout.readline()
        finally:
            process.terminate()


def waited(ask: Callable[[], bool], most: float) -> float:
    """Seconds until a client is served; beyond `most` if it is not."""
    begin = time.monotonic()
    while not ask() and time.monotonic() < begin + most:
        time.sleep(0.1)
    return time.monotonic() - begin


def half_open(cluster: Cluster, number: int = NUMBER, files: int = FILES) -> list[str]:
    """Hold such sessions with each server; returns what is wrong."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, number + 500), hard))
    url = cluster.ensure().render_as_string(hide_password=False)
    with semmap.connect(url, migrate=True) as db:
        db.import_file(OFFICE[0], map="office")

    def connect() -> bool:
        try:
            semmap.connect(url).close()
        except DatabaseError:
            return False
        return True

    def look() -> bool:
        try:
            with find_service(url, "office") as found:
                return found is not None
        except ValueError:
            return False

    waits = {}
    with held(str(cluster.start() / ".s.PGSQL.5432"), number, b"\0"):
        waits["embedded database"] = waited(connect, SECONDS["embedded database"])
    with (
        command(cluster, "fields", "serve", files=files),
        held(str(socket_of(url, "office")), number, b'{"do": '),
    ):
        waits["semmap fields serve"] = waited(look, SECONDS["semmap fields serve"])
    with command(cluster, "serve", "--port", "0", files=files) as line:
        address = httpx.URL(line.split("/maps")[0].split()[-1])
        with held((address.host, address.port), number, b"GET /maps HT"):
            waits["semmap serve"] = waited(
                lambda: httpx.get(f"{address}/maps", timeout=30).status_code == 200,
                SECONDS["semmap serve"],
            )
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    print(
        f"{number} half-open sessions: a client waits for",
        {k: round(v, 1) for k, v in waits.items()},
    )
    return [
        f"{name}: not served in {SECONDS[name]} s beside {number} half-open sessions"
        for name, seconds in waits.items()
        if seconds >= SECONDS[name]
    ]
