"""The twenty questions of the documentation: one at a time, and from 50 clients of the endpoint.

Each answer is compared with the SQL beside it. The clients ask the questions about the small house
in turn, each the next one as soon as it has an answer.
"""

from __future__ import annotations

import asyncio
import json
import os
import time
from itertools import cycle, islice
from pathlib import Path
from urllib.parse import quote

import semmap
from benchmarks.bench_map import use_bench_database
from benchmarks.endpoint import answered, served
from benchmarks.timing import Row, print_rows
from tests.question_page import plain, questions, written
from tests.worlds.conftest import HOTEL, HOUSE, ROOMS

PAGE = "twenty_questions.md"
MAPS = {"house": "The small house", "hotel": "A hotel"}
LIMIT = 0.5  # seconds of one question
CLIENTS, REQUESTS, RATE = 50, 500, 64.0  # a second


def main() -> None:
    """Ask the questions."""
    use_bench_database("questions")
    worlds = Path(os.environ["SEMMAP_WORLDS"])
    with semmap.connect(migrate=True) as db:
        for name, files in {"house": (worlds / HOUSE, ROOMS), "hotel": (worlds / HOTEL,)}.items():
            if name not in db.maps:
                for file in files:
                    db.import_file(file, map=name)
        rows = [
            _asked(db.map(name), question, blocks)
            for name, heading in MAPS.items()
            for question, blocks in questions(PAGE, heading).items()
        ]
        print_rows("twenty questions, first and again", rows)
    print_rows(f"{CLIENTS} clients, {REQUESTS} requests", [_from_clients()])


def _asked(of: semmap.Map, question: str, blocks: dict[str, str]) -> Row:
    seconds = []
    for _ in range(4):
        begin = time.perf_counter()
        answer = of.sparql(blocks["sparql"])
        seconds.append(time.perf_counter() - begin)
    begin = time.perf_counter()
    expected = of.execute(blocks["sql"])
    by_hand = time.perf_counter() - begin
    right = written([plain(term) for term in row] for row in answer.rows) == written(expected)
    return Row(
        f"{of.name}: {question}",
        f"{1e3 * seconds[0]:.0f} ms, {1e3 * min(seconds[1:]):.1f} ms",
        f"SQL {1e3 * by_hand:.1f} ms, {'equal' if right else 'OTHER ROWS'}",
        f"below {1e3 * LIMIT:.0f} ms",
        right and seconds[0] < LIMIT,
    )


def _from_clients() -> Row:
    asked = questions(PAGE, MAPS["house"])
    wanted = {blocks["sparql"]: blocks["text"].count("\n") for blocks in asked.values()}
    queue = iter(list(islice(cycle(wanted), REQUESTS)))
    wrong = 0
    latencies = []

    async def client(port: int, number: int) -> None:
        nonlocal wrong
        for text in queue:
            begin = time.monotonic()
            status, body = await answered(
                port, f"/maps/house/rdf/sparql?query={quote(text)}", f"127.0.1.{number + 1}"
            )
            latencies.append(time.monotonic() - begin)
            rows = len(json.loads(body)["results"]["bindings"]) if status == 200 else -1
            wrong += rows != wanted[text]

    async def all_clients(port: int) -> None:
        await asyncio.gather(*(client(port, number) for number in range(CLIENTS)))

    with served() as port:
        begin = time.monotonic()
        asyncio.run(all_clients(port))
        rate = REQUESTS / (time.monotonic() - begin)
    return Row(
        "the questions about the house",
        f"{rate:.0f} a second, p99 {1e3 * sorted(latencies)[int(0.99 * REQUESTS)]:.0f} ms",
        f"{wrong} of {REQUESTS} answers wrong or refused",
        f"{RATE:.0f} a second",
        rate >= RATE and not wrong,
    )
