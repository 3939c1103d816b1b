"""The topology: loading it from the database, and taking in what changes."""

from __future__ import annotations

import math
import statistics
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from sqlalchemy import Engine, text

from benchmarks.rooms import rooms
from benchmarks.timing import Row, print_rows
from navgrid.options import parts_of
from planner.demo import office_files
from planner.live import Changed, Live
from planner.robot_class import RobotClass
from planner.source.robot_class import keep_robot_class
from planner.source.walks import Walk, keep_walked_until, keep_walks
from planner.topology import OUTSIDE, Topology
from semmap.database import connect
from semmap.ingest.importer import import_file
from semmap.query.change_feed import cursor
from tests.planner.stored import store

__all__ = ["main"]

LOAD_MS, CHANGE_MS, FOLLOW_MS = 50.0, 1.0, 50.0
ROBOT = "benchmark"


def main() -> None:
    """Print the table."""
    engine = connect()
    folder = office_files()[0].parent
    parts = parts_of(folder / "delivery_robot.urdf", None, folder / "delivery_robot_parts.yaml")
    robot = RobotClass(ROBOT, tuple(parts), speed=0.8)
    try:
        with _map(engine, "benchmark building") as name:
            rows = _loading(engine, name, robot)
        with _map(engine, "benchmark office") as name:
            for file in office_files():
                import_file(engine, file, map_name=name)
            rows += _following(engine, name, robot)
    finally:
        with engine.begin() as connection:
            connection.execute(text("DELETE FROM robot_class WHERE name = :name"), {"name": ROBOT})
        engine.dispose()
    print_rows("Topology", rows)


@contextmanager
def _map(engine: Engine, name: str) -> Iterator[str]:
    """The name of a map that is gone afterwards."""
    with engine.begin() as connection:
        if connection.execute(
            text("SELECT 1 FROM map WHERE name = :name"), {"name": name}
        ).scalar():
            connection.execute(text("SELECT drop_map(:name)"), {"name": name})
    try:
        yield name
    finally:
        with engine.begin() as connection:
            connection.execute(text("SELECT drop_map(:name)"), {"name": name})


def _loading(engine: Engine, name: str, robot: RobotClass) -> list[Row]:
    topology = rooms()
    with engine.begin() as connection:
        ids = store(connection, topology, name)
        number = keep_robot_class(connection, robot)
        walks = [*_straight(topology, ids, robot.speed)]
        states = {ids[p.name]: "" for p in topology.places.values()}
        keep_walks(connection, number, walks, states)
    with engine.begin() as connection:  # which sees that as done
        connection.execute(text("SELECT set_config('semmap.map', :name, true)"), {"name": name})
        keep_walked_until(connection, number, cursor(connection))
    with engine.connect() as connection:
        connection.execution_options(isolation_level="AUTOCOMMIT")
        connection.execute(text("VACUUM (ANALYZE)"))  # as the server does when idle
    seconds = []
    for _ in range(31):
        start = time.perf_counter()
        live = Live(engine, name, ROBOT)
        seconds.append(time.perf_counter() - start)
    load = 1e3 * statistics.median(seconds[1:])
    assert live.network.measured == [], live.network.measured
    assert math.isfinite(live.topology.route("room-9-4-18", "room-0-0-0").seconds)
    places = f"{len(topology.places):,} rooms, {len(topology.connectors):,} connectors"
    connector = live.topology.connectors["door-3-2-7"]
    taken = []
    for k in range(101):
        changed = replace(connector, state=("closed", "open")[k % 2])
        start = time.perf_counter()
        live.network.change_connector(changed)
        taken.append(time.perf_counter() - start)
    change = 1e3 * statistics.median(taken)
    return [
        Row(f"load {places}, {len(walks):,} walks", f"{load:.1f} ms", "",
            f"under {LOAD_MS:g} ms", load < LOAD_MS),
        Row("an edge's change", f"{change:.3f} ms", "", f"under {CHANGE_MS:g} ms",
            change < CHANGE_MS),
    ]  # fmt: skip


def _straight(topology: Topology, ids: dict[str, int], speed: float) -> Iterator[Walk]:
    """Walks as the crow flies."""
    inside: dict[str, list[tuple[int, tuple[float, ...]]]] = {}
    for c in topology.connectors.values():
        for place, pose in zip(c.places, c.poses, strict=True):
            if place != OUTSIDE:
                inside.setdefault(place, []).append((ids[c.name], (pose.x, pose.y)))
    for place, stands in inside.items():
        for a, p in stands:
            for b, q in stands:
                if a < b:
                    yield Walk(ids[place], a, b, math.dist(p, q) / speed, math.dist(p, q))


def _following(engine: Engine, name: str, robot: RobotClass) -> list[Row]:
    """From the commit of a change until the network has it."""
    with engine.begin() as connection:
        keep_robot_class(connection, robot)
    live = Live(engine, name, ROBOT)
    heard: list[tuple[float, Changed]] = []
    stop = threading.Event()
    follower = threading.Thread(
        target=live.follow, args=(stop, lambda c: heard.append((time.perf_counter(), c)))
    )
    follower.start()
    time.sleep(3.0)  # until it listens, with its costmaps made
    state = (
        "UPDATE connector SET state = CASE state WHEN 'open' THEN 'closed' ELSE 'open' END "
        "WHERE entity_id = {thing}"
    )
    move = (
        "SELECT move_to({thing}, w.pose[1] %s, w.pose[2] %s, w.pose[3]) FROM world w "
        "WHERE entity_id = {thing}"
    )
    rows = []
    try:
        for job, thing, statements in (
            ("a door that is closed", "door5", [state, state]),
            (
                "a corridor that is blocked",
                "potted_plant8",
                [move % ("- 4.0", "- 1.0"), move % ("+ 4.0", "+ 1.0")],
            ),
            (
                "a cupboard that is moved",
                "bookshelf1",
                [move % ("+ 0.2", ""), move % ("- 0.2", "")],
            ),
        ):
            with engine.connect() as connection:
                number = connection.execute(
                    text("SELECT e.id FROM entity e JOIN map m ON m.id = e.map_id "
                         "WHERE m.name = :map AND e.name = :name"), {"map": name, "name": thing}
                ).scalar_one()  # fmt: skip
            taken = []
            for k in range(12):
                heard.clear()
                with engine.begin() as connection:
                    connection.execute(text(statements[k % 2].format(thing=number)))
                committed = time.perf_counter()
                while not heard and time.perf_counter() < committed + 5.0:
                    time.sleep(0.0005)
                assert heard, f"{job}: nothing was heard"
                taken.append(heard[0][0] - committed)
            took = 1e3 * statistics.median(taken)
            rows.append(
                Row(f"{job}, from its commit", f"{took:.1f} ms", "", f"within {FOLLOW_MS:g} ms",
                    took <= FOLLOW_MS)
            )  # fmt: skip
    finally:
        stop.set()
        follower.join()
    return rows


if __name__ == "__main__":
    main()
