"""The processes that are killed: each works for ever, through restarts of the server.

    python -m tests.soak.actors NAME HOME STATE ...

`HOME` is the folder of the cluster, `STATE` the one in which they store what they have seen.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from pathlib import Path
from random import Random
from typing import Any

from sqlalchemy import Engine

import semmap
from semmap.database import Cluster
from semmap.database.maps import see_map
from semmap.fields.service.client import socket_of
from semmap.fields.service.server import serving
from semmap.fields.service.service import FieldService
from semmap.fields.service.settings import ServiceSettings, SourceSettings
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.ingest.importer import import_file
from semmap.query.entity_query import changes_since
from tests.consistency import POSES
from tests.soak.for_ever import LOST, for_ever
from tests.soak.invariants import last_line, url_of
from tests.soak.kept_span import kept_span
from tests.soak.statements import follower, http_server, http_writer, stater

COUNTED = "steps"
"""The property in which a writer counts its transactions."""

RECORDED = "\n".join(
    json.dumps(
        {
            "time": f"2026-01-31T12:00:{second:02}Z",
            "poses": {"guide": {"from": (2.0, second, 1.6), "to": (3.0, 3.0, 1.0)}},
        }
    )
    for second in range(3)
)
"""A recording of a person who looks around."""

IMPORTED = "imported"
"""The map that importers write."""


def writer(cluster: Cluster, state: Path, *entities: str) -> None:
    """Move entities and count the moves, each by a thread; store each number after its commit."""
    threads = [
        threading.Thread(target=_write, args=(cluster, state, int(entity))) for entity in entities
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def _write(cluster: Cluster, state: Path, entity: int) -> None:
    steps = (0.0, 0.01, 0.0, -0.01)  # things that wander come to stand in each other

    def work(engine: Engine) -> None:
        with engine.begin() as connection:
            number = connection.exec_driver_sql(
                "UPDATE entity SET properties = properties || jsonb_build_object(%s::text, "
                "coalesce((properties->>%s)::int, 0) + 1) WHERE id = %s "
                "RETURNING (properties->>%s)::int",
                (COUNTED, COUNTED, entity, COUNTED),
            ).scalar_one()
            connection.exec_driver_sql(
                "SELECT move_to(entity_id, pose[1] + %s, pose[2], pose[3]) "
                "FROM world WHERE entity_id = %s",
                (steps[number % 4], entity),
            )
        with (state / f"writer-{entity}").open("a") as file:
            file.write(f"{number}\n")

    for_ever(cluster, work)


def importer(cluster: Cluster, state: Path, *files: str) -> None:
    """Import some files in turn, as versions of one file."""
    del state
    draw = Random()

    def work(engine: Engine) -> None:
        import_file(engine, Path(draw.choice(files)), map_name=IMPORTED, source="versions")

    for_ever(cluster, work)


def poller(cluster: Cluster, state: Path) -> None:
    """Store the numbers of all changes, and after them the cursor."""
    file = state / "poller"
    if file.exists():  # a line that was not written as a whole
        text = file.read_text()
        os.truncate(file, len(text[: text.rfind("\n") + 1]))

    def work(engine: Engine) -> None:
        last = last_line(file)
        with engine.begin() as connection:
            driver: Any = connection.connection.driver_connection
            cursor, rows = changes_since(driver, json.loads(last)["cursor"] if last else None)
        with file.open("a") as stored:
            stored.write(json.dumps({"ids": [row["id"] for row in rows], "cursor": cursor}) + "\n")
        time.sleep(0.02)

    for_ever(cluster, work)


def mirror(cluster: Cluster, state: Path, map_name: str) -> None:
    """Mirror a map, and store the mirror whenever it has changed."""
    del state

    def work(engine: Engine) -> None:
        VoxelMirror.resume(engine, map_name).follow(threading.Event(), save_every=0.2)

    for_ever(cluster, work)


def service(cluster: Cluster, state: Path, map_name: str) -> None:
    """Serve the fields of a map with a person who looks around; store which look was kept.

    The looks of another person are a recording, over and over.
    """
    (state / "recorded.jsonl").write_text(RECORDED)
    gaze = SourceSettings("gaze", "gaze")
    recorded = SourceSettings("recorded", "gaze", {"recording": str(state), "loop": True})
    settings = ServiceSettings((gaze, recorded), save_every=1.0, keep_every=0.2, keep_for=60.0)

    def work(engine: Engine) -> None:
        fields = FieldService(engine, map_name, settings=settings)
        with fields.running(), serving(socket_of(url_of(engine), map_name), fields.answer):
            while True:
                eyes, at = (time.time() % 8, 0.0, 1.6), (time.time() % 5, 3.0, 1.0)
                fields.put_percept("gaze", {"poses": {"visitor": {"from": eyes, "to": at}}})
                with suppress(*LOST), engine.connect() as connection:  # it outlives the server
                    see_map(connection, map_name)
                    span = kept_span(connection)
                    if span is not None:
                        with (state / "service").open("a") as file:
                            file.write(f"{span[1].isoformat()}\n")
                time.sleep(0.1)

    for_ever(cluster, work)


def reader(cluster: Cluster, state: Path) -> None:
    """Look for a state of the map in which world and placements disagree; store what it finds."""

    def work(engine: Engine) -> None:
        with engine.connect() as connection:
            wrong = connection.exec_driver_sql(f"{POSES} LIMIT 5").all()
        if wrong:
            with (state / "wrong").open("a") as file:
                file.write(f"a reader saw a wrong world pose: {wrong}\n")
        time.sleep(0.05)

    for_ever(cluster, work)


def observer(cluster: Cluster, state: Path, map_name: str, *names: str) -> None:
    """See an object at places in turn; store where it believes one to be that is no probability."""
    thing, *places = names

    def work(engine: Engine) -> None:
        with semmap.connect(url_of(engine)) as db:
            found = db.map(map_name)
            for number in count():
                found.observe(thing, places[number % len(places)], seen=number % 3 > 0)
                for moves in (None, 60.0):
                    beliefs = dict(found.where(thing, moves=moves))
                    in_range = all(0 <= each <= 1 for each in beliefs.values())
                    if not in_range or abs(sum(beliefs.values()) - 1) > 1e-9:
                        with (state / "wrong").open("a") as file:
                            file.write(f"{thing} is believed to be at {beliefs}\n")
                (state / "observed").write_text(f"{number}\n")
                time.sleep(0.2)

    for_ever(cluster, work)


ACTORS: dict[str, Callable[..., None]] = {
    each.__name__: each
    for each in (
        *(writer, importer, poller, mirror, service, reader, observer),
        *(stater, http_server, http_writer, follower),
    )
}

if __name__ == "__main__":
    logging.getLogger("sqlalchemy.pool").setLevel(logging.CRITICAL)  # connections are lost here
    threading.excepthook = lambda failed: (traceback.print_exception(failed.exc_value), os._exit(1))
    name, home, folder, *arguments = sys.argv[1:]
    ACTORS[name](Cluster(Path(home)), Path(folder), *arguments)
