"""SPARQL on a map of 1,000,000 objects, beside SQL by hand, rdflib and oxigraph.

``SEMMAP_BENCH_OBJECTS=100000 python -m benchmarks knowledge`` takes a smaller map.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import psycopg
import pyoxigraph
import rdflib

import semmap
from benchmarks.database import map_name, map_of
from benchmarks.timing import Row, median_seconds, medians_in_turn, print_rows
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import TRIPLES
from semmap.knowledge.queries import KEPT, limited, query
from semmap.knowledge.vocabulary import GEO, RDF, SEMMAP, prefixes
from semmap.knowledge.whole_graph import triple_query
from semmap.language.parser import parse_sparql

__all__ = ["main"]

OBJECTS = int(os.environ.get("SEMMAP_BENCH_OBJECTS", "1000000"))
RDFLIB_OBJECTS = 100_000
"""rdflib has the facts of so many objects at most: in its memory, a fact takes about a kilobyte."""

SHAPE = "geo:hasDefaultGeometry/geo:asWKT"
BY_HAND = (
    "SELECT e.name FROM object_type o JOIN entity e ON e.id = o.id "
    "JOIN world w ON w.entity_id = o.id"
)


@dataclass(frozen=True)
class Question:
    """A question in SPARQL and SQL.

    Attributes
    ----------
    name : what is asked
    sparql, sql : the texts
    peers : the engines that are measured beside it, with how many times faster it has to be
    """

    name: str
    sparql: str
    sql: str
    peers: tuple[tuple[str, float], ...] = ()


QUESTIONS = (
    Question(
        "where the ten muffins are",
        "SELECT ?x ?t ?r { ?x a semmap:Muffin ; semmap:heldBy ?t . ?t semmap:heldBy ?r }",
        "SELECT e.name, h.name, r.name FROM object_type o JOIN entity e ON e.id = o.id "
        "JOIN placement p ON p.entity_id = o.id JOIN entity h ON h.id = p.holder_id "
        "JOIN placement q ON q.entity_id = p.holder_id JOIN entity r ON r.id = q.holder_id "
        "WHERE o.type = 'muffin' AND o.map_id = (SELECT current_map())",
        (("rdflib", 10), ("oxigraph", 0.5)),
    ),
    Question(
        "the objects on one table, with types",
        "SELECT ?x ?t { ?x semmap:heldBy :object101 ; semmap:directType ?t }",
        "SELECT e.name, e.type FROM placement p JOIN entity e ON e.id = p.entity_id "
        "WHERE p.holder_id = entity_id('object101')",
        (("rdflib", 10), ("oxigraph", 0.5)),
    ),
    Question(
        "rooms with more than 3 tables, of three rooms",
        "SELECT ?r (COUNT(?x) AS ?n) { VALUES ?r { :room1 :room2 :room3 } ?r a semmap:Room . "
        "?x semmap:heldBy ?r ; a semmap:Table } GROUP BY ?r HAVING(COUNT(?x) > 3)",
        "SELECT r.name, count(*) FROM entity r JOIN placement p ON p.holder_id = r.id "
        "JOIN object_type o ON o.id = p.entity_id AND o.type = 'table' "
        "WHERE r.map_id = (SELECT current_map()) AND r.name IN ('room1', 'room2', 'room3') "
        "AND r.kind = 'room' GROUP BY r.id, r.name HAVING count(*) > 3",
        (("rdflib", 10), ("oxigraph", 0.5)),
    ),
    Question(
        "how many things lie on tables in kitchens",
        "SELECT (COUNT(*) AS ?n) { ?r a semmap:Kitchen . ?t semmap:heldBy ?r ; a semmap:Table . "
        "?x semmap:heldBy ?t }",
        "SELECT count(*) FROM object_type k JOIN placement t ON t.holder_id = k.id "
        "JOIN object_type o ON o.id = t.entity_id AND o.type = 'table' "
        "JOIN placement x ON x.holder_id = t.entity_id "
        "WHERE k.type = 'kitchen' AND k.map_id = (SELECT current_map())",
        (("rdflib", 10), ("oxigraph", 0.5)),
    ),
    Question(
        "tables within 3 m of a point",
        f"SELECT ?x {{ ?x a semmap:Table ; {SHAPE} ?w FILTER(geof:distance("
        '?w, "POINT(52 8)"^^geo:wktLiteral, uom:metre) < 3) }',
        f"{BY_HAND} AND w.map_id = (SELECT current_map()) AND w.footprint IS NOT NULL "
        "AND ST_DWithin(w.footprint, 'POINT(52 8)'::geometry, 3) WHERE o.type = 'table'",
    ),
    Question(
        "tables that reach into tables of room 7",
        f"SELECT ?x {{ ?t semmap:heldBy :room7 ; a semmap:Table ; {SHAPE} ?v . "
        f"?x a semmap:Table ; {SHAPE} ?w FILTER(geof:sfIntersects(?v, ?w)) }}",
        "SELECT e.name FROM placement p JOIN object_type t ON t.id = p.entity_id "
        "AND t.type = 'table' JOIN world v ON v.entity_id = p.entity_id "
        "JOIN world w ON ST_Intersects(v.footprint, w.footprint) AND w.map_id = v.map_id "
        "JOIN object_type o ON o.id = w.entity_id AND o.type = 'table' "
        "JOIN entity e ON e.id = w.entity_id WHERE p.holder_id = entity_id('room7')",
        (("oxigraph", 100),),
    ),
)


def facts(session: psycopg.Connection[Any]) -> Iterator[tuple[str, str, str, str]]:
    """Yield the facts that the questions are about: subject, property, object and its tag."""
    view = MapView.of(session)
    values = {"namespace": view.namespace, "map": view.number}
    for triple in TRIPLES:
        wanted = triple.property in (f"{SEMMAP}heldBy", f"{SEMMAP}directType", f"{RDF}type")
        if wanted and triple.subject.form == "entity" and triple.object.form in ("entity", "type"):
            for row in session.execute(triple_query(triple).encode(), values):
                yield row[0], row[2], row[3], "I"
    tables = session.execute(
        "SELECT entity_iri(w.entity_id), ST_AsText(w.footprint) FROM world w JOIN object_type o "
        "ON o.id = w.entity_id AND o.type = 'table' WHERE w.map_id = %s",
        (view.number,),
    )
    for iri, shape in tables:
        yield iri, f"{GEO}hasDefaultGeometry", f"{iri}/shape", "I"
        yield f"{iri}/shape", f"{GEO}asWKT", shape, f"{GEO}wktLiteral"


def oxigraph_store(found: Iterator[tuple[str, str, str, str]]) -> pyoxigraph.Store:
    """Return a store of oxigraph, in memory, with facts."""
    store, nodes = pyoxigraph.Store(), pyoxigraph.NamedNode

    def quads() -> Iterator[pyoxigraph.Quad]:
        for s, p, o, tag in found:
            term = nodes(o) if tag == "I" else pyoxigraph.Literal(o, datatype=nodes(tag))
            yield pyoxigraph.Quad(nodes(s), nodes(p), term)

    store.bulk_extend(quads())
    store.optimize()
    return store


def rdflib_graph(found: Iterator[tuple[str, str, str, str]]) -> rdflib.Graph:
    """Return a graph of rdflib, in memory, with facts."""
    graph, iri = rdflib.Graph(), rdflib.URIRef
    for s, p, o, tag in found:
        graph.add((iri(s), iri(p), iri(o) if tag == "I" else rdflib.Literal(o, datatype=iri(tag))))
    return graph


def count_of_oxigraph(store: pyoxigraph.Store, text: str) -> int:
    """Return how many rows an answer of oxigraph has."""
    spaces = prefixes(map_name(OBJECTS)).items()
    found = store.query("".join(f"PREFIX {p}: <{space}>\n" for p, space in spaces) + text)
    assert isinstance(found, pyoxigraph.QuerySolutions)
    return len(list(found))


def count_of_rdflib(graph: rdflib.Graph, text: str, objects: int) -> int:
    """Return how many rows an answer of rdflib has."""
    return len(graph.query(text, initNs=prefixes(map_name(objects))))


def by_hand(session: psycopg.Connection[Any], question: Question) -> Row:
    """The statement that SPARQL becomes, and the whole answer, beside SQL."""
    with limited(session, None):
        view = MapView.of(session)
        parsed = parse_sparql(question.sparql, "query", tuple(prefixes(view.name).items()))
        statement = view.statement(parsed.algebra.p, [str(n) for n in parsed.names])

        def hand() -> list[Any]:
            return session.execute(question.sql, prepare=False).fetchall()

        def translated() -> list[Any]:
            return session.execute(
                statement.sql.encode(), statement.parameters, prepare=False
            ).fetchall()

        found = len(hand())
        assert found == len(translated()) > 0, question.name
        sql, ours = medians_in_turn(hand, translated, times=31, warm_up=5)
    return Row(
        f"{question.name} ({found} rows)",
        f"{1e3 * ours:.2f} ms",
        f"SQL by hand: {1e3 * sql:.2f} ms",
        "within 2x",
        ours <= 2 * sql,
    )


def again(session: psycopg.Connection[Any], question: Question) -> Row:
    """The answer of a query asked before, a new translation, and SQL by hand; minima."""

    def translated() -> None:
        KEPT._queries.clear()
        query(session, question.sparql)

    by_hand = question.sql.encode()
    new, sql, kept = (
        1e3 * min(median_seconds(run, 1, 0) for _ in range(times))
        for run, times in (
            (translated, 50),
            (lambda: session.execute(by_hand, prepare=False).fetchall(), 100),
            (lambda: query(session, question.sparql), 300),
        )
    )
    return Row(
        question.name,
        f"{kept:.2f} ms asked again, at least",
        f"translated: {new:.2f} ms; SQL by hand: {sql:.2f} ms",
        "< 0.5 ms, or SQL",
        kept < max(0.5, sql),
    )


def beside(
    question: Question, ours: float, found: int, name: str, times: float, run: Callable[[], int]
) -> Row:
    """The whole answer beside that of a peer."""
    start = time.perf_counter()
    assert name == "rdflib" or run() == found, (question.name, name)
    once = time.perf_counter() - start
    theirs = once if once > 1 else median_seconds(run, 11)
    required = f"{times:g}x faster" if times > 1 else f"within {1 / times:g}x"
    return Row(
        f"{question.name} ({found} rows)",
        f"{1e3 * ours:.2f} ms with parsing and terms",
        f"{name}: {1e3 * theirs:.2f} ms",
        required,
        theirs >= times * ours,
    )


def main() -> None:
    """Print the table."""
    few = min(OBJECTS, RDFLIB_OBJECTS)
    with map_of(few) as engine, engine.connect() as connection:
        graph = rdflib_graph(facts(_session(connection, few)))
    with map_of(OBJECTS) as engine, engine.connect() as connection, semmap.connect() as db:
        session = _session(connection, OBJECTS)
        opened = db.map(map_name(OBJECTS)).connection
        start = time.perf_counter()
        store = oxigraph_store(facts(session))
        print(f"oxigraph has {len(store):,} facts after {time.perf_counter() - start:.0f} s")
        session.commit()
        rows = [by_hand(session, question) for question in QUESTIONS]
        session.commit()
        rows += [again(opened, question) for question in QUESTIONS]
        for question in QUESTIONS:
            answer = partial(query, opened, question.sparql)
            ours, found = median_seconds(answer, 31, 5), len(answer().rows)
            peers = {
                "oxigraph": partial(count_of_oxigraph, store, question.sparql),
                "rdflib": partial(count_of_rdflib, graph, question.sparql, few),
            }
            for name, times in question.peers:
                rows.append(beside(question, ours, found, name, times, peers[name]))
        print_rows(f"SPARQL on {OBJECTS:,} objects; rdflib has {few:,}", rows)


def _session(connection: Any, objects: int) -> psycopg.Connection[Any]:
    session = connection.connection.driver_connection
    assert isinstance(session, psycopg.Connection)
    session.execute("SELECT set_config('semmap.map', %s, false)", (map_name(objects),))
    session.commit()
    return session


if __name__ == "__main__":
    main()
