"""1,000 standing subscriptions, from a committed update until its last event is out."""

from __future__ import annotations

import itertools
import statistics
import threading
import time
from collections.abc import Callable, Iterator

import semmap
from benchmarks.bench_map import fresh_map
from benchmarks.timing import Row, print_rows
from semmap.knowledge.queries import query
from semmap.knowledge.standing.subscriptions import Event, Subscriptions
from semmap.knowledge.updates import update

__all__ = ["main"]

NAME = "standing"
TABLES, CANS, PEOPLE, KINDS = 1000, 10_000, 200, 50
ALL = 1000
LIMIT, LIMIT_OF_ALL = 0.010, 0.040
"""Seconds from the return of the commit until all events are out: a few, and one of each query."""

EX = "PREFIX ex: <http://example.org/> "
AREA = (
    '?x geo:hasDefaultGeometry/geo:asWKT ?w FILTER(geof:sfWithin(?w, "POLYGON(({x} 0, {y} 0, '
    '{y} 90, {x} 90, {x} 0))"^^geo:wktLiteral))'
)
MIX = (
    "ASK {{ :human{p} ex:looksAt :can{i} }}",
    "SELECT ?who {{ ?who ex:looksAt :can{i} }}",
    "SELECT ?what {{ :human{p} ex:looksAt ?what . ?what semmap:heldBy :table{t} }}",
    "SELECT ?x {{ ?x semmap:heldBy :table{t} }}",
    "SELECT ?x {{ ?x semmap:heldBy :table{t} ; a <urn:semmap:type#can{k}> }}",
    "SELECT ?x {{ ?x a semmap:Furniture ; semmap:z ?z FILTER(?z > {i}) }}",
    "SELECT ?x {{ ?x semmap:on :table{t} }}",
    "SELECT ?x {{ ?x semmap:in ?y . ?y a semmap:Kitchen . ?x rel:beside :table{t} }}",
    f"SELECT ?x {{{{ ?x a <urn:semmap:type#can{{k}}> . {AREA} }}}}",
    "SELECT ?x {{ GRAPH :human{p} {{ ?x ex:isIn :table{t} }} }}",
)
COUNT = "SELECT (COUNT(?x) AS ?n) {{ ?x semmap:heldBy :table{t} }}"


MOVES = itertools.count(1)
"""Of all sets: no can is moved to the table on which it is."""


def looks(text: str) -> Iterator[str]:
    """Updates that let people look at other cans."""
    for i in itertools.count():
        change = "INSERT" if i % 2 == 0 else "DELETE"
        yield f"{EX}{change} DATA {{ :human{i // 2 % PEOPLE} ex:looksAt :can{7 * (i // 2) % ALL} }}"


def waves(text: str) -> Iterator[str]:
    """Updates that let people wave at cans."""
    for each in looks(text):
        yield each.replace("looksAt", "wavesAt")


def moves(text: str) -> Iterator[str]:
    """Statements that move a can to other tables."""
    for i in MOVES:
        yield (
            f"UPDATE placement SET holder_id = entity_id('table{11 * i % TABLES}') "
            f"WHERE entity_id = entity_id('can{i % 40}')"
        )


SETS: tuple[tuple[str, Callable[[int], str], Callable[[str], Iterator[str]], int], ...] = (
    ("who looks at a can: one each", lambda i: MIX[1], looks, 1),
    (
        "who looks at what, of a kind, on a table: the property of all",
        lambda i: (
            "SELECT ?who ?what {{ ?who ex:looksAt ?what . ?what semmap:heldBy :table{t} ; "
            "a <urn:semmap:type#can{k}> }}"
        ),
        looks,
        0,
    ),
    (
        "who waves at what but a can: events of all",
        lambda i: "SELECT ?who ?what {{ ?who ex:wavesAt ?what FILTER(?what != :can{j}) }}",
        waves,
        ALL,
    ),
    ("what a table holds: the property of all", lambda i: MIX[3], moves, 2),
    ("ten kinds of queries, statements change", lambda i: MIX[i % len(MIX)], looks, 1),
    ("ten kinds of queries, objects move", lambda i: MIX[i % len(MIX)], moves, 1),
    (
        "the same with 20 counts, objects move",
        lambda i: COUNT if i % 50 == 0 else MIX[i % len(MIX)],
        moves,
        1,
    ),
)
"""Each set of subscriptions: what it is, the text of each, the updates, least number of events."""


MAP = f"""
    INSERT INTO model (digest, kind, triangles, closed, hull)
        SELECT 'standing', 'box', 12, true, (SELECT ST_Collect(ST_MakePoint(x, y, z))
            FROM (VALUES (-0.4), (0.4)) a (x), (VALUES (-0.4), (0.4)) b (y),
            (VALUES (0.0), (0.75)) c (z))
        WHERE NOT EXISTS (SELECT FROM model WHERE digest = 'standing');
    INSERT INTO chunk (model_id, number, geom)
        SELECT id, 0, prism_tin(ST_MakeEnvelope(-0.4, -0.4, 0.4, 0.4), 0, 0.75) FROM model
        WHERE digest = 'standing' ON CONFLICT DO NOTHING;
    INSERT INTO semantic_type (name) SELECT 'can' || i FROM generate_series(0, {KINDS - 1}) i
        ON CONFLICT DO NOTHING;
    INSERT INTO type_parent (type, parent) SELECT 'can' || i, 'object'
        FROM generate_series(0, {KINDS - 1}) i ON CONFLICT DO NOTHING;
    INSERT INTO entity (map_id, kind, name, type)
        SELECT current_map(), 'object', 'table' || i, 'table'
        FROM generate_series(0, {TABLES - 1}) i;
    INSERT INTO entity (map_id, kind, name, type) SELECT current_map(), 'object', 'can' || i,
        'can' || i % {KINDS} FROM generate_series(0, {CANS - 1}) i;
    INSERT INTO entity (map_id, kind, name, type)
        SELECT current_map(), 'agent', 'human' || i, 'person'
        FROM generate_series(0, {PEOPLE - 1}) i;
    INSERT INTO entity_model (entity_id, model_id) SELECT entity_id('table' || i), m.id
        FROM generate_series(0, {TABLES - 1}) i, model m WHERE m.digest = 'standing';
    INSERT INTO placement (entity_id, pose) SELECT entity_id('table' || i),
        ARRAY[2 + 3.0 * (i % 32), 2 + 2.5 * (i / 32), 0, 0, 0, 0, 1]
        FROM generate_series(0, {TABLES - 1}) i;
    INSERT INTO placement (entity_id, holder_id, relation, pose) SELECT entity_id('can' || i),
        entity_id('table' || i % {TABLES}), 'on', ARRAY[0, 0, 0.75, 0, 0, 0, 1]
        FROM generate_series(0, {CANS - 1}) i;
    INSERT INTO statement (map_id, subject_id, predicate, object_id) SELECT current_map(),
        entity_id('human' || i % {PEOPLE}), 'http://example.org/looksAt', entity_id('can' || i)
        FROM generate_series({ALL}, {CANS - 1}) i;
    ANALYZE;
"""
"""A hall with tables, cans on them, and people who look at cans."""


def make_map(db: semmap.Database) -> semmap.Map:
    """Make the map."""
    made = db.create_map(NAME)
    made.add_room("hall", [(0, 0), (100, 0), (100, 90), (0, 90)], floor=0, ceiling=3)
    made.connection.execute(MAP.encode())
    return made


def measured(made: semmap.Map, number: int, times: int = 60) -> Row:
    """One set: p50 and p99, beside the evaluation of all."""
    name, text_of, updates, least = SETS[number]
    session = made.connection
    texts = [
        EX
        + text_of(i).format(
            i=i, j=CANS - 1 - i, p=i % PEOPLE, t=i, k=i % KINDS, x=i % 90, y=i % 90 + 9
        )
        for i in range(ALL)
    ]
    arrived: list[float] = []
    done = threading.Event()

    def finish(_: Event) -> None:
        arrived.append(time.perf_counter())
        done.set()

    with Subscriptions(made.database.engine, NAME) as standing:
        start = time.perf_counter()
        standing.add_all(texts, callback=lambda event: arrived.append(time.perf_counter()))
        subscribed = time.perf_counter() - start
        # A query that each update changes is subscribed to last: its event is the last one.
        standing.add(
            EX + "SELECT ?x ?h ?y { { ?x ex:looksAt ?y } UNION { ?x ex:wavesAt ?y } "
            "UNION { ?x semmap:heldBy ?h } }",
            callback=finish,
        )
        seconds, busy, events = [], [], 0
        for turn, change in zip(range(times), updates(name), strict=False):
            time.sleep(0.02)
            arrived.clear()
            done.clear()
            with session.transaction():
                if change.startswith("UPDATE"):
                    session.execute(change)
                else:
                    update(session, change)
            start, before = time.perf_counter(), time.process_time()
            assert done.wait(30), change
            time.sleep(0.01)
            if turn >= 10:
                seconds.append(max(arrived) - start)
                busy.append(time.process_time() - before)
                events += len(arrived)
    assert events >= least * len(seconds), (name, events)
    sample = texts[:: ALL // 20]
    start = time.perf_counter()
    for each in sample:
        query(session, each)
    whole = (time.perf_counter() - start) * len(texts) / len(sample)
    limit = LIMIT_OF_ALL if least == ALL else LIMIT
    p50, p99 = statistics.median(seconds), statistics.quantiles(seconds, n=100)[98]
    fastest, used = min(seconds), statistics.median(busy)
    print(f"{name}: p50 {1e3 * p50:.1f} ms, p99 {1e3 * p99:.1f} ms", flush=True)
    return Row(
        f"{name} ({events / len(seconds):.0f} events an update)",
        f"p50 {1e3 * p50:.1f} ms, p99 {1e3 * p99:.1f} ms, least {1e3 * fastest:.1f} ms; "
        f"{1e3 * used:.1f} ms of processor time; {subscribed:.1f} s to subscribe",
        f"all evaluated again: {1e3 * whole:,.0f} ms",
        f"p99 within {1e3 * limit:.0f} ms",
        p99 <= limit,
    )


def main() -> None:
    """Print the table."""
    with fresh_map(NAME, make_map) as (_, made):
        rows = [measured(made, number) for number in range(len(SETS))]
    entities = CANS + TABLES + PEOPLE
    print_rows(f"{ALL:,} subscriptions on a map of {entities:,} entities", rows)


if __name__ == "__main__":
    main()
