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
from planner.live_topology import LiveTopology, TopologyChange
from planner.readers.robot_class import store_robot_class
from planner.readers.travel_times import (
    MeasuredTravel,
    compute_place_digests,
    store_measured_until,
    store_travel_times,
)
from planner.robot_class import RobotClass
from planner.route_planner import RoutePlanner
from planner.topology import OUTSIDE, Topology
from semmap.database import open_engine
from semmap.ingest.importer import import_file
from semmap.query.map_handle import MapHandle
from tests.office import OFFICE_FILES, delivery_robot
from tests.planner.stored import store
from tests.seen import cursor, seen_by

__all__ = ["main"]

LOAD_MS, CHANGE_MS, FOLLOW_MS = 50.0, 1.0, 50.0
ROBOT = "benchmark"


def main() -> None:
    """Print the table."""
    engine = open_engine()
    robot = delivery_robot(ROBOT)
    try:
        with _map(engine, "benchmark building") as name:
            rows = _loading(engine, name, robot)
        with _map(engine, "benchmark office") as name:
            for file in OFFICE_FILES:
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
        number = store_robot_class(connection, robot)
        travel = [*_straight(topology, ids, robot.speed)]
        digests = compute_place_digests(seen_by(connection), 0.0)  # nothing stands anywhere
        store_travel_times(seen_by(connection), number, travel, digests)
    with engine.begin() as connection:  # which sees that as done
        connection.execute(text("SELECT set_config('semmap.map', :name, true)"), {"name": name})
        store_measured_until(seen_by(connection), number, cursor(seen_by(connection)))
    with engine.connect() as connection:
        connection.execution_options(isolation_level="AUTOCOMMIT")
        connection.execute(text("VACUUM (ANALYZE)"))  # as the server does when idle
    seconds = []
    for _ in range(31):
        start = time.perf_counter()
        live = LiveTopology(MapHandle(engine, name), ROBOT)
        seconds.append(time.perf_counter() - start)
    load = 1e3 * statistics.median(seconds[1:])
    assert live.graph.measured == [], live.graph.measured
    assert math.isfinite(RoutePlanner.of_live(live).route("room-9-4-18", "room-0-0-0").seconds)
    places = f"{len(topology.places):,} rooms, {len(topology.connectors):,} connectors"
    connector = live.topology.connectors["door-3-2-7"]
    taken = []
    for k in range(101):
        changed = replace(connector, state=("closed", "open")[k % 2])
        start = time.perf_counter()
        live.graph.change_connector(changed)
        taken.append(time.perf_counter() - start)
    change = 1e3 * statistics.median(taken)
    return [
        Row(
            f"load {places}, {len(travel):,} travel times",
            f"{load:.1f} ms",
            "",
            f"under {LOAD_MS:g} ms",
            load < LOAD_MS,
        ),
        Row(
            "an edge's change",
            f"{change:.3f} ms",
            "",
            f"under {CHANGE_MS:g} ms",
            change < CHANGE_MS,
        ),
    ]


def _straight(topology: Topology, ids: dict[str, int], speed: float) -> Iterator[MeasuredTravel]:
    """Travel along straight lines."""
    inside: dict[str, list[tuple[int, tuple[float, ...]]]] = {}
    for c in topology.connectors.values():
        for place, pose in zip(c.places, c.poses, strict=True):
            if place != OUTSIDE:
                inside.setdefault(place, []).append((ids[c.name], (pose.x, pose.y)))
    for place, stands in inside.items():
        for a, p in stands:
            for b, q in stands:
                if a < b:
                    yield MeasuredTravel(ids[place], a, b, math.dist(p, q) / speed, math.dist(p, q))


def _following(engine: Engine, name: str, robot: RobotClass) -> list[Row]:
    """From the commit of a change until the graph has it."""
    with engine.begin() as connection:
        store_robot_class(connection, robot)
    live = LiveTopology(MapHandle(engine, name), ROBOT)
    heard: list[tuple[float, TopologyChange]] = []
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
                    text(
                        "SELECT e.id FROM entity e JOIN map m ON m.id = e.map_id "
                        "WHERE m.name = :map AND e.name = :name"
                    ),
                    {"map": name, "name": thing},
                ).scalar_one()
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
                Row(
                    f"{job}, from its commit",
                    f"{took:.1f} ms",
                    "",
                    f"within {FOLLOW_MS:g} ms",
                    took <= FOLLOW_MS,
                )
            )
    finally:
        stop.set()
        follower.join()
    return rows


if __name__ == "__main__":
    main()
