"""A small ASK at the SPARQL endpoint, beside clients whose queries take seconds.

Each client has an address of its own. Light clients send at a steady rate, whether or not the last
answer came; a latency is counted from the moment at which the request was due.
"""

from __future__ import annotations

import asyncio
import os
import re
import statistics
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import quote

import semmap
from benchmarks.bench_map import fresh_map
from benchmarks.timing import Row, print_rows

OFFICE = Path(__file__).parents[1] / "examples/office"
SMALL = "ASK { ?desk a semmap:Desk }"
HEAVY = "SELECT (COUNT(*) AS ?n) {{ ?a ?b ?c . ?d ?e ?f . ?g ?h ?i FILTER(?a != {}) }}"
SECONDS = 20
LIMIT = 0.2

CASES = ((50, 0, 50), (200, 0, 50), (200, 0, 100), (200, 10, 25), (200, 10, 50), (200, 10, 100))
"""Clients, how many of them are heavy, and small requests a second."""


def main() -> None:
    """Measure the endpoint."""
    with fresh_map("bench office", _made) as (_, made), served() as port:
        path = f"/maps/{quote(made.name)}/rdf/sparql?query="
        rows = []
        for clients, heavy, rate in CASES:
            load = _Load(port, path)
            asyncio.run(load.run(clients - heavy, heavy, rate))
            half, *_, last = statistics.quantiles(load.latencies, n=100)[49:]
            answers = ", ".join(f"{n} of {status}" for status, n in sorted(load.answers.items()))
            rows.append(
                Row(
                    f"{clients} clients, {heavy} heavy, {rate} ASK/s",
                    f"p50 {1e3 * half:.0f} ms, p99 {1e3 * last:.0f} ms",
                    f"answers: {answers}",
                    f"p99 below {1e3 * LIMIT:.0f} ms",
                    last < LIMIT and set(load.answers) == {200},
                )
            )
    print_rows(f"a small ASK at the endpoint, {SECONDS} s each", rows)


def _made(database: semmap.Database) -> semmap.Map:
    for name in ("office.sdf", "office_rooms.geojson"):
        database.import_file(OFFICE / name, map="bench office")
    return database.map("bench office")


@contextmanager
def served() -> Iterator[int]:
    """Serve the maps with `semmap serve`, a process of its own."""
    program = "from semmap.cli import main; main()"
    command = [sys.executable, "-c", program, "serve", "--port", "0", "--seconds", "10"]
    server = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=os.environ)
    assert server.stderr is not None
    try:
        found = re.search(r":(\d+)/maps", server.stderr.readline())
        assert found is not None, "the server does not listen"
        yield int(found[1])
    finally:
        server.terminate()
        server.wait()


class _Load:
    """Clients of a server, the latencies of small requests, and how each was answered."""

    def __init__(self, port: int, path: str) -> None:
        self._port, self._path = port, path
        self.latencies: list[float] = []
        self.answers: Counter[int] = Counter()

    async def run(self, light: int, heavy: int, rate: float) -> None:
        """Send requests for `SECONDS`, the heavy ones from two seconds before."""
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(self._heavy(n)) for n in range(heavy)]
            await asyncio.sleep(2 if heavy else 0)
            begin = time.monotonic()
            period = light / rate
            async with asyncio.TaskGroup() as small:
                for n in range(light):
                    small.create_task(self._light(n, begin + n / rate, period, begin + SECONDS))
            for task in tasks:
                task.cancel()

    async def _light(self, number: int, due: float, period: float, end: float) -> None:
        while due < end:
            await asyncio.sleep(due - time.monotonic())
            status, _ = await answered(
                self._port, self._path + quote(SMALL), f"127.0.1.{number + 1}"
            )
            self.latencies.append(time.monotonic() - due)
            self.answers[status] += 1
            due += period

    async def _heavy(self, number: int) -> None:
        with suppress(asyncio.CancelledError):
            while True:
                path = self._path + quote(HEAVY.format(number))
                status, _ = await answered(self._port, path, f"127.0.2.{number + 1}")
                await asyncio.sleep(1 if status == 503 else 0)


async def answered(port: int, path: str, address: str) -> tuple[int, bytes]:
    """Return the status and the body of an answer to a client with an address of its own."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port, local_addr=(address, 0))
    try:
        head = f"GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
        writer.write(head.encode())
        head_of_answer, _, body = (await reader.read()).partition(b"\r\n\r\n")
        return int(head_of_answer.split()[1]), body
    finally:
        writer.close()
