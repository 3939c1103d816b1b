"""From a move to its consequences: until each follower of the map has it, and a route goes by it.

`SEMMAP_WORLDS` names the folder of the worlds. Words choose maps: ``python -m benchmarks.chain
house hotel rooms``. Each follower is measured alone, as a thread of this process, and then all
together.
"""

from __future__ import annotations

import os
import resource
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from queue import SimpleQueue
from subprocess import run

import numpy as np
import shapely

import semmap
from benchmarks.bench_map import use_bench_database
from benchmarks.rooms import furnished
from benchmarks.timing import Row, median_seconds, print_rows
from navgrid.costmap import Costmap
from navgrid.grid import scene_grid
from planner.robot_class import BODY
from semmap.api.map_entity import MapEntity
from semmap.database.notifications import notifications
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.ingest.store.holder_store import derive_inventories
from semmap.ingest.store.world_store import store_world
from semmap.knowledge.standing.subscriptions import Subscriptions
from semmap.query.change_feed import CHANNEL
from semmap.query.map_handle import open_feed
from semmap.query.storey_reader import read_entities, read_scene

__all__ = ["main"]

ROOMS = Path(__file__).parents[1] / "tests/worlds/small_house_rooms.geojson"

LIBRARIES = "numpy, shapely, psycopg, sqlalchemy, scipy.ndimage"

MOVES = 200
PAUSE = 0.03
"""Seconds after a move, in which followers end what they do after they have it."""

IMPORTED, FIRST = 2.0, 0.3
"""Seconds for a file, and of the processor for the first route of a process."""

COMMITTED, ALL = 5.0, 20.0
"""Milliseconds in which 99 of 100 moves are committed, and all followers have them."""

Heard = SimpleQueue[float]
Follower = Callable[[semmap.Map, MapEntity, Heard], AbstractContextManager[None]]


def main() -> None:
    """Print the tables."""
    use_bench_database("chain")
    chosen = sys.argv[1:] if __name__ == "__main__" else []
    with semmap.connect(migrate=True) as db:
        for name in chosen or WORLDS:
            if name in db.maps:
                db.drop_map(name)
            begun = time.perf_counter()
            thing, start = WORLDS[name](db, name)
            took = time.perf_counter() - begun
            rows = [Row("file to map", f"{took:.1f} s", "", f"{IMPORTED:g} s", took <= IMPORTED)]
            rows += [*measured(db.map(name), thing, start), first_route(name, start, thing)]
            db.drop_map(name)
            print_rows(f"From a move to its consequences: {name}", rows)


def house(db: semmap.Database, name: str) -> tuple[str, str]:
    """Import small_house with its rooms; what is moved, and where routes to it start."""
    db.import_file(_worlds() / "small_house/worlds/small_house.world", map=name)
    db.import_file(ROOMS, map=name)
    return "ChairA_01_001", "bedroom"


def hotel(db: semmap.Database, name: str) -> tuple[str, str]:
    """Import the hotel of Open-RMF, and add a chair to its largest room."""
    db.import_file(_worlds() / "rmf/hotel/hotel.building.yaml", map=name)
    here = db.map(name)
    large, *_, other = sorted(here.rooms, key=lambda room: -_ground(room).area)
    x, y = _ground(large).representative_point().coords[0]
    chair = here.add_object("bench_chair", type="chair", size=(0.5, 0.5, 0.9), in_=large.name)
    assert chair.pose is not None
    chair.move_to(x, y, chair.pose.z)
    return chair.name, other.name


def _ground(room: MapEntity) -> shapely.Polygon | shapely.MultiPolygon:
    assert room.footprint is not None
    return room.footprint


def rooms(db: semmap.Database, name: str) -> tuple[str, str]:
    """Store 1,000 rooms with 10,000 objects."""
    here = db.create_map(name)
    with here.transaction():
        session = here.connection
        session.execute("SET LOCAL semmap.deriving = 'off'")
        (number,) = session.execute("SELECT current_map()").fetchone() or (0,)
        store_world(session, number, furnished(), "rooms")
        derive_inventories(session, number)
    here.connection.execute("VACUUM ANALYZE")
    return "table-3-2-7", "room-3-0-18"


WORLDS: dict[str, Callable[[semmap.Database, str], tuple[str, str]]] = {
    "house": house,
    "hotel": hotel,
    "rooms": rooms,
}


def _worlds() -> Path:
    worlds = os.environ.get("SEMMAP_WORLDS")
    if worlds is None:
        sys.exit("set SEMMAP_WORLDS to the folder of the worlds")
    return Path(worlds)


# --- the followers: each puts the time at which it has a change


@contextmanager
def notified(here: semmap.Map, thing: MapEntity, heard: Heard) -> Iterator[None]:
    """A client that waits for the notification."""

    def follow(stop: threading.Event, ready: threading.Event) -> None:
        for sent in notifications(here.engine, (CHANNEL,), stop):
            if sent:
                heard.put(time.perf_counter())
            ready.set()

    with _thread(follow):
        yield


@contextmanager
def mirrored(here: semmap.Map, thing: MapEntity, heard: Heard) -> Iterator[None]:
    """The voxels of all entities."""
    mirror = VoxelMirror(here.engine, here.name)
    mirror.catch_up()

    def follow(stop: threading.Event, ready: threading.Event) -> None:
        ready.set()
        mirror.follow(stop, lambda ids: heard.put(time.perf_counter()))

    with _thread(follow):
        yield


@contextmanager
def mapped(here: semmap.Map, thing: MapEntity, heard: Heard) -> Iterator[None]:
    """The master costmap of the storey in which the thing is."""
    feed = open_feed(here)
    assert thing.storey is not None
    with feed.look() as look:
        scene = read_scene(look.seen, thing.storey.name)
    feed.take_in(look)
    costmap = Costmap(scene, [BODY], scene_grid(scene, 0.05))

    def wake(payloads: tuple[str, ...] | None) -> None:
        with feed.look() as look:
            ids = look.changed or frozenset()
            entities = read_entities(look.seen, ids) if ids else []
        feed.take_in(look)
        if ids and costmap.update(entities, ids - {e.id for e in entities}) is not None:
            heard.put(time.perf_counter())

    def follow(stop: threading.Event, ready: threading.Event) -> None:
        ready.set()
        feed.follow(stop, wake)

    with _thread(follow):
        yield


@contextmanager
def routed(here: semmap.Map, thing: MapEntity, heard: Heard) -> Iterator[None]:
    """The routing graph, with travel in the thing's room measured again."""
    live = here.live_topology()
    live.warm()

    def follow(stop: threading.Event, ready: threading.Event) -> None:
        ready.set()
        live.follow(stop, lambda change: heard.put(time.perf_counter()))

    with _thread(follow):
        yield


@contextmanager
def standing(here: semmap.Map, thing: MapEntity, heard: Heard) -> Iterator[None]:
    """A standing query for the thing's place."""
    with Subscriptions(here.database.engine, here.name) as queries:
        queries.add(f"SELECT ?x {{ :{thing.name} semmap:x ?x }}")

        def follow(stop: threading.Event, ready: threading.Event) -> None:
            ready.set()
            for event in queries.events():
                if event.what == "appeared":
                    heard.put(time.perf_counter())

        thread = threading.Thread(target=follow, args=(threading.Event(), threading.Event()))
        thread.start()
        yield
    thread.join()


FOLLOWERS: dict[str, Follower] = {
    "a notification": notified,
    "the voxels": mirrored,
    "a master costmap": mapped,
    "the routing graph": routed,
    "a standing query": standing,
}


@contextmanager
def _thread(follow: Callable[[threading.Event, threading.Event], None]) -> Iterator[None]:
    stop, ready = threading.Event(), threading.Event()
    thread = threading.Thread(target=follow, args=(stop, ready))
    thread.start()
    ready.wait()
    time.sleep(0.5)  # until it listens
    try:
        yield
    finally:
        stop.set()
        thread.join()


# --- the rows


def measured(here: semmap.Map, name: str, start: str) -> list[Row]:
    """The milliseconds of each stage, the middle one and that of 99 of 100."""
    thing = here[name]
    committed = [done - began for began, done in _moves(thing)]
    rows = [_row("a move, until it is committed", committed, COMMITTED)]
    for what, follower in FOLLOWERS.items():
        heard: Heard = SimpleQueue()
        with follower(here, thing, heard):
            took = [heard.get(timeout=20) - done for _, done in _moves(thing)]
        rows.append(_row(f"from there to {what}", took, ALL))
    rows.append(_row("all of these together", _together(here, thing), ALL))
    for what, ask in (
        ("where it is believed to be", lambda: here.where(name)),
        (f"a route from {start} to it", lambda: here.route(start, name)),
    ):
        took = []
        ask()
        for _, done in _moves(thing):
            ask()
            took.append(time.perf_counter() - done)
        rows.append(_row(f"from there to {what}", took, ALL))
    return rows


def first_route(name: str, start: str, goal: str) -> Row:
    """The processor time of a process that asks for one route."""
    words = f"import semmap; semmap.connect().map({name!r}).route({start!r}, {goal!r})"
    with_route, libraries = (
        median_seconds(lambda said=said: run([sys.executable, "-c", said], check=True), clock=_used)  # type: ignore[misc]
        for said in (words, f"import {LIBRARIES}")
    )
    reference = f"{LIBRARIES}: {libraries:.2f} s"
    shown = f"{with_route:.2f} s of the processor"
    return Row("the first route of a process", shown, reference, f"{FIRST} s", with_route <= FIRST)


def _used() -> float:
    """Processor time of the processes that ended, in seconds."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _together(here: semmap.Map, thing: MapEntity) -> list[float]:
    """Seconds from the commit until the last follower has it."""
    took = []
    with ExitStack() as stack:
        queues: list[Heard] = []
        for follower in FOLLOWERS.values():
            queues.append(SimpleQueue())
            stack.enter_context(follower(here, thing, queues[-1]))
        for _, done in _moves(thing):
            took.append(max(heard.get(timeout=20) for heard in queues) - done)
    return took


def _moves(thing: MapEntity) -> Iterator[tuple[float, float]]:
    """Move it there and back; yields when each call began, and when it returned."""
    assert thing.pose is not None
    x, y, z = thing.pose[:3]
    for number in range(MOVES):
        began = time.perf_counter()
        thing.move_to(x + (0.1, 0.0)[number % 2], y, z)
        yield began, time.perf_counter()
        time.sleep(PAUSE)


def _row(what: str, took: list[float], limit: float) -> Row:
    middle, late = 1e3 * np.percentile(took, (50, 99))
    shown = f"{middle:.1f} ms, 99 of 100 in {late:.1f} ms"
    return Row(what, shown, "", f"99 of 100 in {limit:g} ms", bool(late <= limit))


if __name__ == "__main__":
    main()
