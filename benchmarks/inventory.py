"""Moves with their holders derived again, beside the same moves without: one object and 10,000."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psycopg
from sqlalchemy import text

from benchmarks.timing import Row, median_seconds, print_rows
from semmap.database import Cluster, open_engine
from semmap.geometry.mesh import box_mesh
from semmap.geometry.pose import Pose
from semmap.ingest.store.holder_store import derive_inventories
from semmap.ingest.store.world_store import store_world
from semmap.ingest.world import Entry, PlaceDetail, Shape, StoreyDetail, World

MOVE = """
UPDATE placement p SET pose = pose_compose(p.pose, ARRAY[%(by)s, 0, 0, 0, 0, 0, 1])
WHERE p.entity_id = ANY (%(ids)s)
"""


def building(
    rooms: int = 100, tables: int = 10, cups: int = 9, *, side: float = 10, on: bool = True
) -> World:
    """Square rooms of 10 m, each with ten tables, each table with nine cups: 10,000 objects.

    `side` metres is the length of a room. The cups stand on their table, or before it.
    """
    entries = [Entry("ground", "storey", detail=StoreyDetail(0, 3))]
    table = Shape("mesh", box_mesh((-0.8, -0.4, 0), (0.8, 0.4, 0.75)))
    cup = Shape("mesh", box_mesh((-0.04, -0.04, 0), (0.04, 0.04, 0.1)))
    row = round((side - 2) / 4)
    for i in range(rooms):
        x, y = side * (i % 10), side * (i // 10)
        floor = Shape("mesh", box_mesh((0, 0, 0), (side - 0.2, side - 0.2, 2.6)))
        entries.append(
            Entry(
                f"room{i}",
                "room",
                pose=Pose(x, y),
                shapes=[floor],
                detail=PlaceDetail(floor=0, ceiling=2.6),
            )
        )
        for j in range(tables):
            u, v = x + 2 + 4 * (j % row), y + 1 + 1.8 * (j // row)
            entries.append(Entry(f"table{i}_{j}", "object", pose=Pose(u, v), shapes=[table]))
            entries += [
                Entry(
                    f"cup{i}_{j}_{k}",
                    "object",
                    pose=Pose(u - 0.6 + 0.14 * k, v, 0.75)
                    if on
                    else Pose(u - 0.6 + 0.14 * k, v + 0.9),
                    shapes=[cup],
                )
                for k in range(cups)
            ]
    return World("building", Path("building"), entries)


@contextmanager
def stored(world: World) -> Iterator[psycopg.Connection[Any]]:
    """A session on the map of a world, in a database of its own."""
    folder = Path(tempfile.mkdtemp(prefix="semmap-inventory-", dir="/tmp"))
    folder.chmod(0o755)
    os.environ["SEMMAP_DATA"] = str(folder)
    engine = open_engine()
    with engine.begin() as connection:
        of_map = connection.execute(text("INSERT INTO map (name) VALUES ('building') RETURNING id"))
        number = of_map.scalar_one()
        driver: Any = connection.connection.driver_connection
        driver.execute("SET LOCAL semmap.deriving = 'off'")
        store_world(driver, number, world, "building")
        derive_inventories(driver, number)
    url = engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    engine.dispose()
    with psycopg.connect(url, autocommit=True) as session:
        session.execute("SET search_path = semmap, public; SET semmap.map = 'building'")
        session.execute("VACUUM ANALYZE")
        yield session
    Cluster(folder).stop()
    shutil.rmtree(folder)


def seconds_of_a_hall() -> float:
    """Seconds to move 10,000 objects in one statement, most of them on the floor of one hall."""
    with stored(building(1, 1000, side=90, on=False)) as session:
        ids = [row[0] for row in session.execute("SELECT id FROM entity WHERE kind = 'object'")]
        took = []
        for by in (0.01, -0.01):
            start = time.perf_counter()
            session.execute(MOVE, {"by": by, "ids": ids})
            took.append(time.perf_counter() - start)
    return min(took)


def measured() -> list[Row]:
    """One statement that moves 10,000 objects, and moves of one cup and of one table with nine."""
    hall = seconds_of_a_hall()
    with stored(building()) as session:
        by = 0.01
        ids = {
            names: [
                row[0]
                for row in session.execute(
                    "SELECT id FROM entity WHERE kind = 'object' AND name LIKE %s", [names]
                )
            ]
            for names in ("%", "cup50\\_5\\_5", "table50\\_5")
        }

        def move(names: str, deriving: str) -> None:
            nonlocal by
            by = -by
            session.execute("SELECT set_config('semmap.deriving', %s, false)", [deriving])
            session.execute(MOVE, {"by": by, "ids": ids[names]})

        def seconds(names: str, deriving: str) -> float:
            start = time.perf_counter()
            move(names, deriving)
            return time.perf_counter() - start

        move("cup50\\_5\\_5", "")  # a first plan made for one row must serve 10,000, too
        many = {how: min(seconds("%", how) for _ in range(2)) for how in ("off", "")}
        one = {
            (names, how): median_seconds(lambda n=names, h=how: move(n, h), 41)  # type: ignore[misc]
            for names in ("cup50\\_5\\_5", "table50\\_5")
            for how in ("off", "")
        }
        left = session.execute(
            "SELECT derive_again(ARRAY(SELECT id FROM entity WHERE kind = 'object'))"
        ).fetchone()
        assert left == (0,), left
    found = [
        Row(
            "10,000 objects moved in one statement",
            f"{many['']:.2f} s",
            f"without deriving: {many['off']:.2f} s",
            "< 3 s",
            many[""] < 3,
        ),
        Row("10,000 objects of one hall, on its floor", f"{hall:.2f} s", "", "< 3 s", hall < 3),
    ]
    for names, what in (("cup50\\_5\\_5", "a cup"), ("table50\\_5", "a table with nine cups")):
        more = (one[names, ""] - one[names, "off"]) * 1e3
        found.append(
            Row(
                f"one move of {what}",
                f"{one[names, ''] * 1e3:.1f} ms",
                f"without deriving: {one[names, 'off'] * 1e3:.1f} ms",
                "< 2 ms more",
                more < 2,
            )
        )
    return found


def main() -> None:
    """Print the table."""
    print_rows("The inventory follows moves", measured())


if __name__ == "__main__":
    main()
