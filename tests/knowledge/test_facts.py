"""Facts about resources that are not entities may have the map's vocabulary."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import psycopg
import rdflib

from semmap.knowledge.map_view import MapView
from semmap.knowledge.queries import query
from semmap.knowledge.rdf_file import parse_facts, store_facts
from semmap.knowledge.updates import update
from semmap.knowledge.whole_graph import dump, facts, serialized
from tests.knowledge.engines import Engines, comparable
from tests.knowledge.test_query import EX, OXIGRAPH_DIFFERS, QUERIES

FOREIGN = """
PREFIX ex: <http://example.org/>
INSERT DATA {
    ex:mug a semmap:Cup, oro:Opening, oro:Artifact ; semmap:heldBy :table, ex:tray ; semmap:z 0.8 ;
        semmap:name "mug" ; prop:colour "red", "blue" ; prop:mass 2 ; rel:beside :sofa, ex:hall ;
        oro:isOn ex:tray ; semmap:onStorey ex:ground .
    ex:tray a semmap:Table ; semmap:heldBy :studio ; semmap:state "open" .
    ex:door a bot:Interface ; bot:interfaceOf :studio, ex:hall .
    ex:hall a bot:Space ; geo:hasGeometry [ geo:asWKT "POINT(1 2)"^^geo:wktLiteral ] .
}
"""
SEEN = (
    "SELECT ?x ?h { ?x semmap:heldBy ?h }",
    "SELECT ?x { ?x semmap:heldBy :table }",
    "SELECT ?x { ?x semmap:heldBy :studio ; a semmap:Table }",
    "SELECT ?x { ?x semmap:heldBy+ :studio }",
    "SELECT ?x ?y { ?x semmap:heldBy/semmap:heldBy ?y }",
    "SELECT ?x ?c { ?x a semmap:Cup ; prop:colour ?c }",
    "SELECT ?x { ?x rel:beside|oro:isOn ?y }",
    "SELECT ?x ?y { ?x ^rel:beside ?y }",
    "SELECT ?y { ex:door bot:interfaceOf ?y }",
    "SELECT ?p ?o { ex:mug ?p ?o }",
    "SELECT ?x ?w { ?x geo:hasGeometry/geo:asWKT ?w }",
    "SELECT ?x ?z { ?x semmap:z ?z FILTER(?z > 0.75) }",
    "SELECT ?x { ?x a semmap:Cup FILTER NOT EXISTS { ?x semmap:heldBy ex:tray } }",
    "CONSTRUCT { ?h semmap:holds ?x } { ?x semmap:heldBy ?h }",
    "ASK { ex:mug a semmap:Cup ; semmap:heldBy :table }",
)


def test_foreign_facts_are_seen_beside_those_of_the_map(changing: psycopg.Connection) -> None:
    assert update(changing, FOREIGN).added == 23
    engines = Engines(changing)
    for text in (*SEEN, *QUERIES):
        if not any(part in text for part in OXIGRAPH_DIFFERS):
            assert comparable(query(changing, EX + text)) == engines.oxigraph(EX + text), text
    described = query(changing, f"{EX} DESCRIBE ex:mug").graph
    assert described is not None
    assert len(described) >= 13


def test_foreign_facts_are_deleted(changing: psycopg.Connection) -> None:
    before = Counter(facts(changing))
    update(changing, FOREIGN)
    graph = MapView.of(changing)
    for name in ("mug", "tray", "door", "hall"):
        assert update(changing, f"{EX} DELETE WHERE {{ ex:{name} ?p ?o }}").removed
        assert not list(graph.triples((rdflib.URIRef(f"http://example.org/{name}"), None, None)))
    update(changing, "DELETE WHERE { ?x geo:asWKT 'POINT(1 2)'^^geo:wktLiteral }")
    assert Counter(facts(changing)) == before


def test_foreign_facts_are_exported_and_imported_again(changing: psycopg.Connection) -> None:
    update(changing, FOREIGN)
    text = serialized(dump(changing), "nquads")
    before = Counter(facts(changing))
    update(changing, "DELETE WHERE { ?x bot:interfaceOf ?y }")
    update(changing, f"{EX} DELETE WHERE {{ ex:mug ?p ?o }}")
    assert store_facts(changing, parse_facts(text, "nquads", Path("map.nq")), Path("map.nq")) == 16
    assert Counter(facts(changing)) == before


def test_a_map_without_foreign_facts_is_read_as_before(changing: psycopg.Connection) -> None:
    text = f"{EX} SELECT ?x ?y {{ ?x semmap:heldBy ?y ; prop:colour ?c }}"
    before = query(changing, text).explanation[0]
    update(changing, f"{EX} INSERT DATA {{ ex:kettle a ex:Device, semmap:Stove ; ex:of :table }}")
    assert query(changing, text).explanation[0] == before
    assert "UNION" not in before
    update(changing, f"{EX} INSERT DATA {{ ex:kettle semmap:heldBy :table ; prop:colour 'red' }}")
    assert "UNION" in query(changing, text).explanation[0]
