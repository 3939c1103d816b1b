"""A database with a small map, which the cases of many kinds are tried on.

It is that of `SERVER`; the program that runs cases starts it (`served`).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import psycopg
from nacl.signing import SigningKey

import semmap
from semmap.database.embedded import Cluster
from semmap.error import Error
from semmap.knowledge.updates import update
from semmap.manipulation.store.actions import add_actions
from semmap.manipulation.store.bundle import trust
from semmap.manipulation.store.devices import add_gripper
from semmap.manipulation.store.models import set_shape
from semmap.manipulation.store.tasks import record_task
from tests.fuzz.kind import SERVER
from tests.knowledge.conftest import STATED
from tests.manipulation.cup_map import candidate, primitive
from tests.manipulation.grippers import BY_HAND

OFFICE = Path(__file__).parents[2] / "examples" / "office"
ENDPOINT = "endpoint"
"""The map that requests over HTTP change."""

KEY = SigningKey(bytes(range(32)))


@contextmanager
def served() -> Iterator[None]:
    """Run a server with the map, for all processes that inherit the environment."""
    with TemporaryDirectory(prefix="semmap-fuzz-", ignore_cleanup_errors=True) as folder:
        Path(folder).chmod(0o755)
        cluster = Cluster(Path(folder))
        url = cluster.ensure().render_as_string(hide_password=False)
        try:
            prepare(url)
            os.environ[SERVER] = url
            yield
        finally:
            os.environ.pop(SERVER, None)
            cluster.stop()


def prepare(url: str) -> None:
    """Make a small map with statements, a gripper and what it learned."""
    with semmap.connect(url, migrate=True) as db:
        asked = db.create_map(ENDPOINT)
        asked.add_room("studio", [(0, 0), (5, 0), (5, 4), (0, 4)], floor=0, ceiling=3)
        loft = db.create_map("loft")
        loft.add_room("studio", [(0, 0), (5, 0), (5, 4), (0, 4)], floor=0, ceiling=3)
        loft.add_object("table", type="dining_table", size=(1.6, 0.9, 0.75), pose=(2, 2, 0))
        for name, x in (("cup 1", 1.5), ("cup 2", 2.5)):
            loft.add_object(name, type="cup", size=(0.1, 0.1, 0.1), pose=(x, 2, 0.75))
        for name in ("sofa", "shelf/left", "ann", "bob"):
            loft.add_object(name, type="sofa", size=(1, 0.5, 0.8), pose=(4, 3, 0))
        session = loft.connection
        update(session, STATED)
        opens = {"form": "parallel", "opening": 0.1, "depth": 0.05}
        add_gripper(session, "two_fingers", urdf=BY_HAND, joints={"left": (0, 0.05)}, **opens)
        set_shape(session, "cup 1", primitive("cuboid", 0.1, 0.1, 0.1))
        (known, _) = add_actions(session, "cup 1", None, [candidate(), candidate(yaw=1.0)])
        record_task(session, "cup 1", action=known, outcome="completed")
        db.add_robot("two_wheels", OFFICE / "delivery_robot.urdf")
        trust(session, "other", bytes(KEY.verify_key).hex())


@cache
def loft() -> semmap.Map:
    """The map that this process has open."""
    return semmap.connect(os.environ[SERVER]).map("loft")


def close() -> None:
    """Close the map, if it is open."""
    if loft.cache_info().currsize:
        loft().database.close()
        loft.cache_clear()


@contextmanager
def undone(here: psycopg.Connection[Any]) -> Iterator[None]:
    """A transaction of a map or database that ends without a change, whatever was refused."""
    with here.transaction() as transaction:
        yield
        raise psycopg.Rollback(transaction)


@contextmanager
def case_map(path: Path) -> Iterator[semmap.Map]:
    """The map of a file, dropped afterwards; a refused file leaves none.

    One process at a time has one: a drop of a map that waits for an import may end by a deadlock.
    """
    database, name = loft().database, f"case {os.getpid()}"
    database.session.execute("SELECT pg_advisory_lock(7)")
    try:
        try:
            database.import_file(path, map=name)
        except Error:
            assert name not in database.maps, "a refused file changes nothing"
            raise
        try:
            yield database.map(name)
        finally:
            database.drop_map(name)
    finally:
        database.session.execute("SELECT pg_advisory_unlock(7)")


def import_case(path: Path) -> None:
    """Import a file as a map, and drop that."""
    with case_map(path):
        pass
