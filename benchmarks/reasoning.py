"""OWL 2 RL over the shipped T-Box and 100,000 entities: at first, and after one change."""

from __future__ import annotations

import os
import time
from typing import Any

import psycopg
import rdflib

import semmap
from benchmarks.bench_map import use_bench_database
from benchmarks.timing import Row, median_seconds, print_rows
from semmap import Map
from semmap.knowledge.map_view import MapView
from semmap.knowledge.reasoning.runs import reason, refresh
from semmap.knowledge.sparql.scope import NOTHING_INFERRED
from semmap.knowledge.updates import update
from semmap.knowledge.vocabulary import PREFIXES

__all__ = ["main"]

NAME = "reasoning"
ENTITIES = int(os.environ.get("SEMMAP_BENCH_ENTITIES", "100000"))
FEW = 1_000
"""For the peer, which takes hours for all."""
EX = "PREFIX ex: <http://example.org/> "
AXIOMS = """INSERT DATA {
    semmap:Drinkware rdfs:subClassOf ex:Breakable . ex:Breakable rdfs:subClassOf ex:Delicate .
    ex:Breakable owl:disjointWith ex:Sturdy . semmap:Furniture rdfs:subClassOf ex:Sturdy .
    ex:Careful owl:onProperty rel:stores ; owl:someValuesFrom ex:Delicate .
    rel:beside a owl:SymmetricProperty . ex:partOf a owl:TransitiveProperty .
    ex:owner a owl:FunctionalProperty ; rdfs:range semmap:Agent . ex:owns owl:inverseOf ex:owner .
}"""
MAP = """
INSERT INTO entity (map_id, kind, name, type)
    SELECT current_map(), 'room', 'room' || i, 'kitchen' FROM generate_series(1, %(rooms)s) i;
INSERT INTO entity (map_id, kind, name, type)
    SELECT current_map(), 'object', 'object' || i, (ARRAY['cup', 'mug', 'table', 'chair', 'book',
    'bottle', 'bookshelf', 'sofa', 'apple', 'laptop'])[1 + i %% 10]
    FROM generate_series(1, %(entities)s - %(rooms)s) i;
ANALYZE entity, object_type;
INSERT INTO link (from_id, relation, to_id)
    SELECT r.id, 'stores', e.id FROM entity e JOIN entity r ON r.map_id = e.map_id
    AND r.name = 'room' || 1 + e.id %% %(rooms)s
    WHERE e.map_id = current_map() AND e.kind = 'object';
INSERT INTO link (from_id, relation, to_id)
    SELECT a.id, 'beside', b.id FROM entity a JOIN entity b ON b.id = a.id + 1
    AND b.map_id = a.map_id WHERE a.map_id = current_map() AND a.kind = 'object' AND a.id %% 10 = 0
"""
"""Objects of ten types, each linked to one of the rooms, and a tenth of them to another."""


def made(db: semmap.Database, entities: int) -> Map:
    """A map of entities, a hundredth of them rooms."""
    made = db.create_map(NAME)
    with made.transaction():
        for statement in MAP.split(";"):
            values = {"rooms": entities // 100, "entities": entities}
            made.connection.execute(statement.encode(), values)
        update(made.connection, EX + AXIOMS, seconds=600)
    made.execute("ANALYZE")
    return made


def after_one(session: psycopg.Connection[Any], changes: tuple[str, ...]) -> float:
    """The median seconds of the reasoner after changes by SQL that alternate."""
    taken = []
    for i in range(22):
        with session.transaction():
            session.execute(changes[i % len(changes)].encode())
        with session.transaction():
            view = MapView.of(session)
            start = time.perf_counter()
            done = refresh(view)
            taken.append(time.perf_counter() - start)
        assert done is not None
        assert not done.complete
        assert done.added or done.removed, changes
    return sorted(taken[2:])[10]


CHANGES = {
    "an object gets another type": (
        "UPDATE entity SET type = 'table' WHERE id = entity_id('object1')",
        "UPDATE entity SET type = 'mug' WHERE id = entity_id('object1')",
    ),
    "the only link of an object": (
        "INSERT INTO link VALUES (entity_id('object3'), 'beside', entity_id('object90'))",
        "DELETE FROM link WHERE from_id = entity_id('object3') AND to_id = entity_id('object90')",
    ),
    "an owner, and none": (
        "INSERT INTO statement (map_id, subject_id, predicate, object_id) SELECT current_map(), "
        "entity_id('object7'), 'http://example.org/owner', entity_id('object8')",
        "DELETE FROM statement WHERE predicate = 'http://example.org/owner'",
    ),
}


def by_reasonable(session: psycopg.Connection[Any]) -> tuple[float, str]:
    """Seconds of reasonable on the same facts: types with supertypes, links, axioms."""
    import reasonable

    graph = rdflib.Graph()
    with session.transaction():
        view = MapView.of(session)
        view.inferred = NOTHING_INFERRED
        verbs = ["rdf:type", "rdfs:subClassOf", "rdfs:range", "rel:stores", "rel:beside"]
        verbs += [f"owl:{n}" for n in ("disjointWith", "onProperty", "someValuesFrom", "inverseOf")]
        for verb in verbs:
            iri = rdflib.URIRef(PREFIXES[verb.split(":")[0]] + verb.split(":")[1])
            for triple in view.triples((None, iri, None)):
                graph.add(triple)
    start = time.perf_counter()
    reasoner = reasonable.PyReasoner()
    reasoner.from_graph(graph)
    found = len(reasoner.reason())
    seconds = time.perf_counter() - start
    return seconds, f"reasonable: {seconds:.1f} s for {found:,} triples from {len(graph):,}"


def beside_reasonable(session: psycopg.Connection[Any]) -> Row:
    """The first run on a small map, beside the peer's."""
    done = reason(session, complete=True, seconds=600)
    seconds, peer = by_reasonable(session)
    ours = f"{done.seconds:.2f} s with reading and storing"
    name = f"OWL 2 RL over the T-Box and {FEW:,} entities"
    return Row(name, ours, peer, "no slower", done.seconds <= seconds)


def rows(session: psycopg.Connection[Any]) -> list[Row]:
    """Time the first run, and one after each change."""
    done = reason(session, complete=True, seconds=600)
    found = [
        Row(
            f"OWL 2 RL over the T-Box and {ENTITIES:,} entities",
            f"{done.seconds:.1f} s, {done.inferences:,} inferences stored",
            "",
            "< 30 s",
            done.seconds < 30,
        )
    ]
    for name, changes in CHANGES.items():
        seconds = after_one(session, changes)
        nothing = median_seconds(lambda: session.execute("SELECT 1").fetchall(), 51, 5)
        peer = f"SELECT 1: {nothing * 1e3:.2f} ms"
        each = f"{1e3 * seconds:.1f} ms"
        found.append(Row(f"after one change: {name}", each, peer, "< 50 ms", seconds < 50e-3))
    return found


def main() -> None:
    """Print the table."""
    use_bench_database()
    found = []
    with semmap.connect(migrate=True) as db:
        for entities in (FEW, ENTITIES):
            if NAME in db.maps:
                db.drop_map(NAME)
            session = made(db, entities).connection
            found += [beside_reasonable(session)] if entities == FEW else rows(session)
        db.drop_map(NAME)
    print_rows("Reasoning", found)


if __name__ == "__main__":
    main()
