"""Facts about resources that are not entities may have the map's vocabulary."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import psycopg
import pytest
import rdflib

from semmap.ingest.world import WorldError
from semmap.knowledge.facts import Fact, FactWriter
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import COMPUTED
from semmap.knowledge.queries import query
from semmap.knowledge.rdf_file import parse_facts, store_facts
from semmap.knowledge.reasoning.runs import reason
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


def test_foreign_resources_have_the_superclasses_of_their_types(
    changing: psycopg.Connection,
) -> None:
    ask = f"{EX} ASK {{ ex:jug a semmap:Drinkware }}"
    reason(changing)
    update(changing, f"{EX} INSERT DATA {{ ex:jug a semmap:Cup }}")
    assert query(changing, ask).truth
    update(changing, f"{EX} DELETE DATA {{ ex:jug a semmap:Cup }}")
    assert not query(changing, ask).truth
    update(changing, f"{EX} INSERT DATA {{ ex:jug a semmap:Cup }}")
    reason(changing)
    assert query(changing, ask).truth


EX_MUG = rdflib.URIRef("http://example.org/mug")
HEAD = """
PREFIX owl: <http://www.w3.org/2002/07/owl#> PREFIX ex: <http://example.org/>
PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#>
PREFIX xsd: <http://www.w3.org/2001/XMLSchema#>
PREFIX geo: <http://www.opengis.net/ont/geosparql#>
PREFIX bot: <https://w3id.org/bot#> PREFIX sosa: <http://www.w3.org/ns/sosa/>
PREFIX dul: <http://www.ontologydesignpatterns.org/ont/dul/DUL.owl#>
PREFIX oro: <http://kb.openrobots.org#> PREFIX knowrob: <http://knowrob.org/kb/knowrob.owl#>
"""
ONTOLOGIES = {
    """<https://w3id.org/bot> a owl:Ontology ; owl:versionInfo "0.3" .
    bot:Zone a owl:Class ; rdfs:label "Zone"@en ; owl:disjointWith bot:Interface .
    bot:Storey a owl:Class ; rdfs:subClassOf bot:Zone .
    bot:interfaceOf a owl:ObjectProperty ; rdfs:domain bot:Interface ;
        rdfs:range [ a owl:Class ; owl:unionOf ( bot:Zone bot:Element ) ] .
    bot:hasStorey a owl:ObjectProperty ; owl:propertyChainAxiom ( bot:hasBuilding bot:hasStorey ) .
    ex:b1 a bot:Building ; bot:hasStorey ex:level1 . ex:level1 a bot:Storey ; bot:hasSpace ex:r1 .
    ex:r1 a bot:Space ; bot:containsElement ex:w1 . ex:i1 a bot:Interface ; bot:interfaceOf ex:r1 .
    """: "ex:level1 a bot:Storey ; bot:hasSpace ?x . ?x bot:containsElement ex:w1 . "
    "ex:i1 bot:interfaceOf ?x",
    """<http://www.w3.org/ns/sosa/> a owl:Ontology .
    sosa:Sensor a owl:Class ; rdfs:comment "Device that responds to a stimulus"@en .
    sosa:madeObservation a owl:ObjectProperty ; owl:inverseOf sosa:madeBySensor .
    ex:s1 a sosa:Sensor , geo:Feature ; sosa:madeObservation ex:o1 ;
        geo:hasGeometry [ a geo:Geometry ; geo:asWKT "POINT Z(1 2 3)"^^geo:wktLiteral ] .
    ex:o1 a sosa:Observation ; sosa:hasSimpleResult 22.5 ;
        sosa:resultTime "2026-01-01T00:00:00Z"^^xsd:dateTime .
    """: "ex:s1 a geo:Feature ; geo:hasGeometry/geo:asWKT ?w FILTER(STR(?w) = 'POINT Z(1 2 3)')",
    """<http://www.ontologydesignpatterns.org/ont/dul/DUL.owl> a owl:Ontology .
    dul:PhysicalObject a owl:Class ; rdfs:subClassOf dul:Object , [ a owl:Restriction ;
        owl:onProperty dul:isParticipantIn ; owl:someValuesFrom dul:Event ] .
    dul:Agent a owl:Class ; rdfs:subClassOf dul:Object ; rdfs:label "Agente"@it .
    dul:hasLocation a owl:ObjectProperty , owl:TransitiveProperty .
    ex:p1 a dul:PhysicalObject , owl:NamedIndividual ; dul:hasLocation ex:p2 .
    """: "ex:p1 a dul:PhysicalObject . dul:Agent rdfs:label 'Agente'@it",
    """<http://kb.openrobots.org> a owl:Ontology .
    oro:Agent a owl:Class ; rdfs:subClassOf oro:SpatialThing ; rdfs:comment "acts" .
    oro:Opening a owl:Class . oro:isOn a owl:ObjectProperty ; rdfs:subPropertyOf oro:isAt .
    oro:myself a oro:Agent ; rdfs:label "me" ; oro:isIn ex:lab . ex:door9 a oro:Opening .
    ex:book a oro:Artifact ; oro:isOn ex:desk .
    """: "oro:myself a oro:Agent ; oro:isIn ex:lab . ex:door9 a oro:Opening . "
    "ex:book a oro:Artifact ; oro:isOn ex:desk",
    """<http://knowrob.org/kb/knowrob.owl> a owl:Ontology ;
        owl:imports <http://www.ontologydesignpatterns.org/ont/dul/DUL.owl> .
    knowrob:Cup a owl:Class ; rdfs:subClassOf dul:PhysicalObject , [ a owl:Restriction ;
        owl:onProperty knowrob:depthOfObject ; owl:cardinality "1"^^xsd:nonNegativeInteger ] .
    knowrob:depthOfObject a owl:DatatypeProperty , owl:FunctionalProperty ; rdfs:range xsd:double .
    [] a owl:AllDisjointClasses ; owl:members ( knowrob:Cup knowrob:Door ) .
    ex:cup7 a knowrob:Cup ; knowrob:depthOfObject "0.08"^^xsd:double .
    """: "ex:cup7 a knowrob:Cup ; knowrob:depthOfObject 0.08e0",
}
"""Small files in the manner of published ontologies, each with a pattern that matches then."""


@pytest.mark.parametrize("text", ONTOLOGIES, ids=("bot", "sosa", "dul", "oro", "knowrob"))
def test_ontologies_load_as_they_are(changing: psycopg.Connection, text: str) -> None:
    new = parse_facts(HEAD + text, "turtle", Path("ontology.ttl"))
    ask = f"{HEAD} ASK {{ {ONTOLOGIES[text]} }}"
    before = Counter(facts(changing))
    assert not query(changing, ask).truth
    assert store_facts(changing, new, Path("ontology.ttl")) > 0
    assert query(changing, ask).truth
    assert not before - Counter(facts(changing))


STREAM = """
PREFIX ex: <http://example.org/> PREFIX : <urn:semmap:map:loft#>
PREFIX semmap: <urn:semmap:ontology#>
ex:list ex:has [ ex:of :bowl ], ex:mug . ex:mug ex:beside :bowl, :jar ; a ex:Mug, semmap:Cup .
ex:archive { :bowl ex:was ex:clean . ex:mug ex:beside :bowl . :jar ex:was ex:full }
ex:mug ex:beside :bowl . :bowl ex:size 5 . :bowl a semmap:Cup . :jar a semmap:Cup .
:jar semmap:placedOn :table . ex:mug a ex:Mug .
"""


@pytest.mark.parametrize("batch", [1, 2, 3, 5, 10_000])
def test_facts_are_stated_in_parts(
    changing: psycopg.Connection, monkeypatch: pytest.MonkeyPatch, batch: int
) -> None:
    monkeypatch.setattr("semmap.knowledge.facts._BATCH", batch)
    before = Counter(facts(changing))
    read = parse_facts(STREAM, "trig", Path("a.trig"))
    assert store_facts(changing, iter(read), Path("a.trig")) == len(set(read)) == 14
    after = Counter(facts(changing))
    named = {fact for fact in read if not any(isinstance(t, rdflib.BNode) for t in fact)}
    assert {fact: after[fact] for fact in named} == dict.fromkeys(named, 1)
    assert sum(isinstance(f[2], rdflib.URIRef) and "blank" in f[2] for f in after - before) == 1
    row = changing.execute(
        "SELECT count(*) FROM statement s, entity e "
        "WHERE e.name = 'bowl' AND e.id IN (s.subject_id, s.object_id)"
    ).fetchone()
    assert row == (5,)


def test_a_command_has_its_own_terms_alone(
    changing: psycopg.Connection, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("semmap.knowledge.facts._BATCH", 3)
    sent: list[int] = []
    made = FactWriter._change_statements

    def counted(self: FactWriter, some: list[tuple[Fact, str]], sql: str) -> Any:
        found = made(self, some, sql)
        sent.append(len(self._terms))
        return found

    monkeypatch.setattr(FactWriter, "_change_statements", counted)
    table = MapView.of(changing).namespace + "table"
    lines = "".join(f"<{table}> <http://example.org/p{n}> {n} .\n" for n in range(9))
    path = Path("a.ttl")
    assert store_facts(changing, parse_facts(lines, "turtle", path), path) == 9
    assert update(changing, f"DELETE DATA {{ {lines} }}").removed == 9
    assert sent == [6] * 6


def test_a_statement_that_no_file_can_have_is_taken_back(changing: psycopg.Connection) -> None:
    changing.execute(
        "INSERT INTO statement (map_id, subject, predicate, object, tag) "
        "VALUES (current_map(), 'urn:a', 'urn:b', 'no IRI', 'I')"
    )
    assert update(changing, "DELETE WHERE { <urn:a> ?p ?o }").removed == 1


@pytest.mark.parametrize("batch", [2, 10_000])
def test_a_fact_that_is_refused_late_changes_nothing(
    changing: psycopg.Connection, monkeypatch: pytest.MonkeyPatch, batch: int
) -> None:
    monkeypatch.setattr("semmap.knowledge.facts._BATCH", batch)
    before = Counter(facts(changing))
    computed = rdflib.URIRef(COMPUTED[0].property)
    read = [*parse_facts(STREAM, "trig", Path("a.trig")), Fact(EX_MUG, computed, EX_MUG)]
    with pytest.raises(WorldError, match="computed"):
        store_facts(changing, read, Path("a.trig"))
    assert Counter(facts(changing)) == before
