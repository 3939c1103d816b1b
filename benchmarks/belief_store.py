"""One new observation in a map with 10,000 objects, until a client has the announced belief."""

from __future__ import annotations

import select
import time

import psycopg

import semmap
from benchmarks.bench_map import fresh_map
from benchmarks.timing import Row, median_seconds, print_rows
from semmap.belief.store.beliefs import add_observations, read_belief
from tests.seen import seen_by

__all__ = ["main"]

OBJECTS, TABLES = 10_000, 30
NAME = "beliefs"


def make_map(db: semmap.Database) -> semmap.Map:
    """A hall with tables, and objects of which each was observed once."""
    made = db.create_map(NAME)
    made.add_room("hall", [(0, 0), (40, 0), (40, 10), (0, 10)], floor=0, ceiling=3)
    with made.transaction():
        for i in range(TABLES):
            pose = (1 + 2.5 * (i % 15), 2 + 4 * (i // 15), 0)
            made.add_object(f"table{i}", type="table", size=(1.6, 0.8, 0.75), pose=pose)
        made.execute(
            "INSERT INTO entity (map_id, kind, name, type) SELECT current_map(), 'object', "
            "'can' || i, 'can' FROM generate_series(0, %s) i",
            OBJECTS - 1,
        )
    names = [f"table{i}" for i in range(TABLES)]
    start = time.perf_counter()
    add_observations(
        made.connection,
        [
            {"object": f"can{i}", "place": names[i % TABLES], "seen": bool(i % 3)}
            for i in range(OBJECTS)
        ],
    )
    seconds = time.perf_counter() - start
    print(f"first observation of {OBJECTS:,} objects at once: {seconds:.1f} s", flush=True)
    made.execute("ANALYZE observation, belief")
    return made


def rows(made: semmap.Map, url: str) -> list[Row]:
    """Time an observation until another session was notified, and read the belief there."""
    seen = seen_by(made.connection)
    number = 0
    found: list[float] = []
    with psycopg.connect(url, autocommit=True) as follower:
        follower.execute("SET search_path = semmap, public")
        follower.execute("SELECT set_config('semmap.map', %s, false)", (NAME,))
        follower.execute("LISTEN semmap")

        def observe() -> None:
            nonlocal number
            number += 1
            name, place = f"can{number * 37 % OBJECTS}", f"table{number % TABLES}"
            add_observations(made.connection, [{"object": name, "place": place, "seen": True}])
            select.select([follower.pgconn.socket], [], [], 5)
            assert list(follower.notifies(timeout=0, stop_after=1))

        def stored() -> None:
            follower.execute(
                "SELECT probability FROM belief WHERE entity_id = entity_id(%s)",
                (f"can{number * 37 % OBJECTS}",),
            ).fetchall()

        def both() -> None:
            observe()
            stored()

        announced = median_seconds(both, 51, 10)
        nothing = median_seconds(lambda: made.execute("SELECT 1"), 51, 5)
        computed = median_seconds(
            lambda: found.append(sum(read_belief(seen, "can7").values())), 21, 5
        )
        assert max(abs(total - 1) for total in found) < 1e-12
    return [
        Row(
            f"{OBJECTS:,} objects: an observation to its announced belief, read by another client",
            f"{announced * 1e3:.1f} ms",
            f"SELECT 1: {nothing * 1e3:.2f} ms; where_is: {computed * 1e3:.1f} ms",
            "< 20 ms",
            announced < 20e-3,
        )
    ]


def main() -> None:
    """Print the table."""
    with fresh_map(NAME, make_map) as (db, made):
        url = db.engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
        print_rows("Beliefs in the database", rows(made, url))
