"""All pairs of near, on and the like, beside oxigraph with the pairs as facts, and moves.

A building of 10,000 objects, 20 in a room, and the small house of 87 where SEMMAP_WORLDS has it.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pyoxigraph
import shapely
from sqlalchemy import text

import semmap
from benchmarks.bench_map import use_bench_database
from benchmarks.inventory import building
from benchmarks.timing import Row, median_seconds, medians_in_turn, print_rows
from semmap.database.maps import driver_of
from semmap.ingest.store.holder_store import derive_inventories
from semmap.ingest.store.world_store import store_world
from semmap.knowledge.vocabulary import prefixes
from tests.worlds.conftest import HOUSE, ROOMS

__all__ = ["main"]

RELATIONS = ("on", "near", "touching", "in", "above")
MOST_MS = 100.0
ROWS_A_MS = 200  # of an answer, whose terms Python makes: more than that are not read in MOST_MS
MOVE = "SELECT move_to(entity_id('cup50_1_5'), %s, 1.9, 0.75)"


def question(relation: str) -> str:
    """All pairs of a relation, in SPARQL."""
    return f"SELECT ?a ?b {{ ?a semmap:{relation} ?b }}"


def made(db: semmap.Database) -> semmap.Map:
    """Return the map of 500 rooms, each with two tables and nine cups on each."""
    if "pairs" in db.maps:
        db.drop_map("pairs")
    with db.engine.begin() as connection:
        of_map = connection.execute(text("INSERT INTO map (name) VALUES ('pairs') RETURNING id"))
        number = of_map.scalar_one()
        driver = driver_of(connection)
        driver.execute("SET LOCAL semmap.deriving = 'off'")
        store_world(driver, number, building(500, 2, 9, side=10), "pairs")
        derive_inventories(driver, number)
        driver.execute("ANALYZE")
    return db.map("pairs")


def oxigraph(relation: str, rows: list[tuple[str, str]]) -> pyoxigraph.Store:
    """Return a store that has the pairs as facts."""
    store, node = pyoxigraph.Store(), pyoxigraph.NamedNode
    verb = node(f"{prefixes('pairs')['semmap']}{relation}")
    store.bulk_extend(pyoxigraph.Quad(node(a), verb, node(b)) for a, b in rows)
    return store


def read(store: pyoxigraph.Store, text: str) -> int:
    """Return how many rows an answer of oxigraph has, after all are read."""
    found = store.query(text, prefixes={"semmap": prefixes("pairs")["semmap"]})
    assert isinstance(found, pyoxigraph.QuerySolutions)
    return sum(1 for _ in ((str(row[0]), str(row[1])) for row in found))


def all_pairs(of: semmap.Map, relation: str, objects: int) -> list[Row]:
    """The first question, which decides all pairs, the next ones, and their number alone."""
    begin = time.perf_counter()
    rows = of.sparql(question(relation)).rows
    first = time.perf_counter() - begin
    store = oxigraph(relation, [(str(a), str(b)) for a, b in rows])
    assert read(store, question(relation)) == len(rows)
    counted = f"SELECT (COUNT(*) AS ?n) {{ ?a semmap:{relation} ?b }}"
    ours, peer, count = medians_in_turn(
        lambda: of.sparql(question(relation)),
        lambda: read(store, question(relation)),
        lambda: of.sparql(counted),
        times=15,
        warm_up=3,
    )
    readable = len(rows) <= ROWS_A_MS * MOST_MS
    return [
        Row(
            f"{relation}: {len(rows):,} pairs of {objects:,} objects",
            f"{1e3 * ours:.1f} ms ({len(rows) / ours / 1e3:,.0f} rows a ms)",
            f"oxigraph with the pairs as facts: {1e3 * peer:.1f} ms, {peer / ours:.1f}x; "
            f"decided at first: {1e3 * first:,.0f} ms",
            f"< {MOST_MS:g} ms" if readable else "reported: so many rows",
            not readable or 1e3 * ours < MOST_MS,
        ),
        Row(
            f"{relation}: how many",
            f"{1e3 * count:.1f} ms",
            f"decided at first: {1e3 * first:,.0f} ms",
            f"< {MOST_MS:g} ms",
            1e3 * count < MOST_MS,
        ),
    ]


def brute_force(of: semmap.Map) -> Row:
    """Pairs of near between objects, beside an index of Shapely on the ground, heights after it."""
    session = of.connection
    placed = session.execute(
        "SELECT w.footprint, ST_ZMin(w.box), ST_ZMax(w.box) FROM world w "
        "JOIN entity e ON e.id = w.entity_id WHERE e.kind = 'object' AND w.map_id = current_map()"
    ).fetchall()
    grounds = shapely.from_wkb([str(row[0]) for row in placed])

    low, high = np.array([row[1:] for row in placed]).T

    def by_shapely() -> int:
        a, b = shapely.STRtree(grounds).query(grounds, predicate="dwithin", distance=1.0)
        up = np.maximum(np.maximum(low[a] - high[b], low[b] - high[a]), 0)
        apart = np.hypot(shapely.distance(grounds[a], grounds[b]), up)
        return int(((apart <= 1) & (a != b)).sum())

    counted = (
        "SELECT count(*) FROM pairs_near(current_map()) p JOIN entity a ON a.id = p.a "
        "AND a.kind = 'object' JOIN entity b ON b.id = p.b AND b.kind = 'object'"
    )
    assert session.execute(counted).fetchone() == (by_shapely(),)
    ours, peer = medians_in_turn(lambda: session.execute(counted).fetchone(), by_shapely, times=5)
    return Row(
        "near between objects, in SQL",
        f"{1e3 * ours:.1f} ms",
        f"Shapely's STRtree: {1e3 * peer:.0f} ms, {peer / ours:.0f}x; the same pairs",
        f"< {MOST_MS:g} ms",
        1e3 * ours < MOST_MS,
    )


def moves(of: semmap.Map) -> list[Row]:
    """A committed move with kept pairs and without, and the question after it."""
    session = of.connection
    where = (0.01, -0.01)
    step = 0

    def move() -> None:
        nonlocal step
        step += 1
        session.execute(MOVE, (2.0 + where[step % 2],))
        session.commit()

    kept = median_seconds(move, 101, 10)
    after = []
    for _ in range(5):
        move()
        begin = time.perf_counter()
        of.sparql("SELECT (COUNT(*) AS ?n) { ?a semmap:near ?b }")
        after.append(time.perf_counter() - begin)
    session.execute("DELETE FROM kept_relation")
    session.commit()
    bare = median_seconds(move, 101, 10)
    return [
        Row(
            "a committed move of a cup",
            f"{1e3 * kept:.2f} ms",
            f"where nothing is kept: {1e3 * bare:.2f} ms",
            "at most 10 % more",
            kept <= 1.1 * bare,
        ),
        Row(
            "how many are near, after a move",
            f"{1e3 * sorted(after)[2]:.1f} ms",
            "",
            f"< {MOST_MS:g} ms",
            1e3 * sorted(after)[2] < MOST_MS,
        ),
    ]


def main() -> None:
    """Print the tables."""
    use_bench_database("pairs")
    with semmap.connect(migrate=True) as db:
        worlds = os.environ.get("SEMMAP_WORLDS")
        if worlds is not None:
            if "house" in db.maps:
                db.drop_map("house")
            for file in (Path(worlds) / HOUSE, ROOMS):
                db.import_file(file, map="house")
            of, few = db.map("house"), len(db.map("house").find("object"))
            rows = [row for name in RELATIONS for row in all_pairs(of, name, few)]
            for name in ("leftOf", "inFrontOf"):
                rows += all_pairs(of, name, few)[:1]
            print_rows("relations between all objects of the small house", rows)
        of = made(db)
        rows = [row for name in RELATIONS for row in all_pairs(of, name, 10_000)]
        print_rows("relations between all of 10,000 objects", [*rows, brute_force(of), *moves(of)])
        db.drop_map("pairs")


if __name__ == "__main__":
    main()
