"""The processes that state facts, by SPARQL and by HTTP, and one that follows a standing query."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path

import httpx
from sqlalchemy import Engine

import semmap
from semmap.cli import main
from semmap.database import Cluster
from tests.soak.for_ever import for_ever
from tests.soak.invariants import STATED, last_line, url_of

TOKEN = "a-token-of-a-robot"

REFUSALS = 408, 503
"""Of a request that came too slowly, and of a server that has too many or no database."""

SECONDS = 600
"""A machine that runs dozens of processes of the trial gives an update little time."""

UPDATE = (
    "DELETE {{ :{0} <urn:soak:count> ?n }} INSERT {{ :{0} <urn:soak:count> {1} }} "
    "WHERE {{ OPTIONAL {{ :{0} <urn:soak:count> ?n }} }}"
)
"""State a number in place of the former one; also right where it is there already."""


def _count(file: Path, state_number: Callable[[str], bool]) -> None:
    """State the next number of an entity, until it is acknowledged, and store it."""
    name, number = file.name.partition("-")[2], int(last_line(file) or 0) + 1
    while not state_number(UPDATE.format(name, number)):
        time.sleep(0.05)
    with file.open("a") as stored:
        stored.write(f"{number}\n")


def stater(cluster: Cluster, state: Path, map_name: str, entity: str) -> None:
    """State a number of an entity by SPARQL, and count on."""

    def work(engine: Engine) -> None:
        with semmap.connect(url_of(engine)) as db:
            found = db.map(map_name)

            def state_number(text: str) -> bool:
                return found.update(text, seconds=SECONDS) is not None

            while True:
                _count(state / f"stated-{entity}", state_number)

    for_ever(cluster, work)


def http_server(cluster: Cluster, state: Path, port: str) -> None:
    """Be `semmap serve`; again where the database was killed before it served."""
    tokens = state / "tokens"
    tokens.touch(0o600)
    tokens.write_text(f"{TOKEN} semmap_robot\n")
    os.environ["SEMMAP_DATA"] = str(cluster.home)
    again = [sys.executable, *sys.orig_argv[1:]]
    sys.argv = ["semmap", "serve", "--port", port, "--tokens", str(tokens)]
    with redirect_stderr(StringIO()) as printed:
        try:
            main()
        except SystemExit:
            sys.__stderr__.write(printed.getvalue())
            if "http://" in printed.getvalue() or "Usage" in printed.getvalue():  # it served
                raise
    os.execv(sys.executable, again)


def http_writer(cluster: Cluster, state: Path, map_name: str, entity: str, port: str) -> None:
    """State a number of an entity by HTTP, and count on; a busy server may refuse it."""
    del cluster

    def post(text: str) -> bool:
        try:
            answer = client.post(f"/maps/{map_name}/update", json={"text": text})
        except httpx.TransportError:  # the server was killed
            return False
        if answer.status_code not in (200, *REFUSALS):
            with (state / "wrong").open("a") as file:
                file.write(f"HTTP answers {answer.status_code}: {answer.text[:300]}\n")
        return answer.status_code == 200

    headers = {"Authorization": f"Bearer {TOKEN}"}
    with httpx.Client(base_url=f"http://127.0.0.1:{port}", headers=headers, timeout=60) as client:
        while True:
            _count(state / f"stated-{entity}", post)


def follower(cluster: Cluster, state: Path, map_name: str) -> None:
    """Follow the stated numbers; store how many there are, and those that were seen to appear."""
    file = state / "follower"
    file.unlink(missing_ok=True)

    def work(engine: Engine) -> None:
        with semmap.connect(url_of(engine)) as db, db.map(map_name).watch_sparql(STATED) as events:
            seen: set[tuple[str, int]] = set()
            count = events.count
            while True:
                new = file.with_suffix(".new")
                new.write_text(json.dumps({"count": count, "seen": sorted(seen)}))
                new.replace(file)
                event = next(iter(events))
                answer = (str(event.values["s"]), int(event.values["n"]))
                count += 1 if event.what == "appeared" else -1
                (seen.add if event.what == "appeared" else seen.discard)(answer)

    for_ever(cluster, work)
