"""SPARQL through a map, judged by SQL and by rdflib on the map's own graph."""

from __future__ import annotations

import queue
from collections import Counter
from datetime import datetime
from pathlib import Path

import psycopg
import pytest
import rdflib
from rdflib.compare import isomorphic

import semmap
from semmap.knowledge.rdf_file import FORMATS
from semmap.knowledge.vocabulary import prefixes
from semmap.knowledge.whole_graph import without_warnings
from semmap.language.error import QueryError
from tests.forked import semmap_process

HELD = "SELECT ?x ?room { ?x semmap:heldBy ?room . ?room semmap:kind 'room' ; semmap:name ?n }"


def test_rows_are_names_as_sql_has_them(small_house: semmap.Map) -> None:
    answer = small_house.sparql(HELD)
    assert answer.names == ("x", "room")
    expected = small_house.sql(
        "SELECT e.name, h.name FROM placement p JOIN entity e ON e.id = p.entity_id "
        "JOIN entity h ON h.id = p.holder_id WHERE h.kind = 'room' AND e.map_id = current_map()"
    )
    assert len(answer) == len(expected) > 20
    assert Counter(answer) == Counter(expected)
    assert all(name in small_house for name, _ in answer)
    assert answer[0] in expected.rows
    assert answer._repr_html_().count("<tr>") == 1 + min(100, len(answer))
    assert answer


def test_rdflib_answers_the_same_on_the_graph(small_house: semmap.Map) -> None:
    graph = small_house.graph()
    with without_warnings():
        found = [tuple(row) for row in graph.query(HELD, initNs=prefixes("house"))]
    assert Counter(small_house.sparql(HELD).rows) == Counter(found)


def test_values_are_those_of_python(small_house: semmap.Map) -> None:
    text = """SELECT ?n ?d ?b ?s ?t ?c ?u { VALUES (?n ?d ?b ?s ?t ?c) {
        (7 2.5 true "mug" "2026-01-31T10:00:00Z"^^xsd:dateTime semmap:Chair) } }"""
    ((number, half, truth, name, time, kind, unbound),) = small_house.sparql(text)
    assert (number, float(half), truth, name, kind, unbound) == (
        7,
        2.5,
        True,
        "mug",
        "semmap:Chair",
        None,
    )
    assert time == datetime.fromisoformat("2026-01-31T10:00:00Z")


def test_truth_graphs_and_notes(small_house: semmap.Map) -> None:
    assert small_house.sparql("ASK { :Refrigerator_01_001 semmap:heldBy :kitchen }")
    no = small_house.sparql("ASK { :kitchen semmap:heldBy :Refrigerator_01_001 }")
    assert not no
    assert no.truth is False
    made = small_house.sparql("CONSTRUCT { ?x rel:beside ?y } { ?x semmap:placedOn ?y }")
    assert isinstance(made.graph, rdflib.Graph)
    assert (
        len(made)
        == len(made.graph)
        == len(small_house.sparql("SELECT ?x { ?x semmap:placedOn ?y }"))
    )
    assert ("rel:beside") in {verb for _, verb, _ in made}
    assert not small_house.sparql("DESCRIBE :nothing")
    wrong = small_house.sparql("SELECT ?x { ?x semmap:heldBy :kitchenn }")
    assert not wrong
    assert "kitchen" in " ".join(wrong.notes)
    with pytest.raises(QueryError, match="line 1, column"):
        small_house.sparql("SELECT ?x { ?x semmap:heldBy }")
    with pytest.raises(ValueError, match="more than 3 rows"):
        small_house.sparql(HELD, rows=3)


def test_queries_are_those_of_a_login_that_only_reads(small_house: semmap.Map) -> None:
    with small_house.reading() as session:
        assert session.info.user == "semmap_read"
    assert small_house.sparql("SELECT ?x { :kitchen semmap:name ?x }")[0] == ("kitchen",)


@pytest.fixture
def flat(db: semmap.Database) -> semmap.Map:
    made = db.create_map("flat")
    made.add_room("kitchen", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=2.6)
    made.add_room("hall", [(5, 0), (9, 0), (9, 3), (5, 3)], floor=0, ceiling=2.6)
    made.add_object("table1", type="table", size=(1, 1, 0.7), in_="kitchen")
    made.add_object("cup 1", type="cup", size=(0.1, 0.1, 0.1), on="table1")
    return made


def test_an_update_is_seen_in_its_transaction_and_undone_with_it(flat: semmap.Map) -> None:
    red = "ASK { :cup%201 prop:colour 'red' }"
    with flat.transaction() as transaction:
        changes = flat.update("INSERT DATA { :cup%201 prop:colour 'red' }")
        assert (changes.added, changes.removed) == (1, 0)
        assert flat.sparql(red)
        raise psycopg.Rollback(transaction)
    assert not flat.sparql(red)
    flat.update("INSERT DATA { :cup%201 prop:colour 'red' ; rdfs:label 'cup of ann' }")
    assert flat.sparql(red)
    assert flat["cup 1"].properties == {"colour": "red"}
    assert flat["cup 1"].describe()["label"] == "cup of ann"
    with pytest.raises(QueryError, match=r"line 1.*follows from"):
        flat.update("INSERT DATA { :cup%201 semmap:x 3 }")


def test_answers_that_appear_and_disappear_are_followed(flat: semmap.Map) -> None:
    text = "SELECT ?x { ?x semmap:heldBy :hall }"
    heard: queue.SimpleQueue[tuple[str, object]] = queue.SimpleQueue()
    with (
        flat.watch_sparql(text) as events,
        flat.watch_sparql(text, lambda event: heard.put((event.what, event.values))),
    ):
        assert events.count == 0
        flat["cup 1"].move_to(6, 1, 0.05)
        event = next(iter(events))
        assert (event.what, event.values) == ("appeared", {"x": "cup 1"})
        flat["cup 1"].put_on("table1")  # at its middle
        assert next(iter(events)).what == "disappeared"
        expected = [("appeared", {"x": "cup 1"}), ("disappeared", {"x": "cup 1"})]
        assert [heard.get(timeout=20) for _ in expected] == expected
    assert list(flat.watch_sparql(text, seconds=0.2)) == []
    with pytest.raises(QueryError):
        flat.watch_sparql("SELECT ?x {")


@pytest.mark.parametrize(
    ("pattern", "change"),
    [
        ("GRAPH <urn:new> { VALUES ?x { 1 } }", "appeared"),
        ("GRAPH ?x {}", "appeared"),
        ("VALUES ?x { 1 } FILTER NOT EXISTS { GRAPH <urn:new> {} }", "disappeared"),
    ],
)
def test_a_graph_that_begins_is_noticed(flat: semmap.Map, pattern: str, change: str) -> None:
    with flat.watch_sparql(f"SELECT ?x {{ {pattern} }}", seconds=20) as events:
        flat.update("INSERT DATA { GRAPH <urn:new> { :table1 rel:of :ann } }")
        assert next(iter(events)).what == change


def test_a_variable_that_is_not_grouped_is_refused(flat: semmap.Map) -> None:
    query = "SELECT ?x (COUNT(?y) AS ?n) { ?x semmap:heldBy ?y }"
    reason = r"line 1, column \d+: \?x is neither grouped by nor aggregated"
    with pytest.raises(QueryError, match=reason):
        flat.sparql(query)
    with pytest.raises(QueryError, match=reason):
        flat.watch_sparql(query)
    with pytest.raises(QueryError, match=reason):
        flat.update(f"INSERT {{ ?x rel:of ?n }} WHERE {{ {query} }}")


@pytest.mark.parametrize("ending", ["ttl", "jsonld", "trig", "nt", "nq"])
def test_files_have_the_graph(flat: semmap.Map, tmp_path: Path, ending: str) -> None:
    flat.update("INSERT DATA { :table1 rel:beside :cup%201 . GRAPH :ann { :cup%201 rel:of :ann } }")
    path = tmp_path / f"flat.{ending}"
    count = flat.export_rdf(str(path))
    graph = flat.graph()
    read = rdflib.Dataset()
    with without_warnings():
        read.parse(data=path.read_text(), format=FORMATS[path.suffix])
        assert count == len(graph)
        assert isomorphic(read.default_graph, graph.default_graph)
    in_graph = ending in ("trig", "nq", "jsonld")
    ann = rdflib.URIRef("urn:semmap:map:flat#ann")
    assert (len(read.graph(ann)) > 0) == in_graph
    assert flat.import_rdf(path) == 0
    with pytest.raises(ValueError, match="nothing is inferred"):
        flat.export_rdf(path, inferences=True)


def test_facts_of_a_file_are_added_as_a_whole(flat: semmap.Map, tmp_path: Path) -> None:
    path = tmp_path / "facts.ttl"
    space = "@prefix : <urn:semmap:map:flat#> . @prefix s: <urn:semmap:ontology#> . "
    path.write_text(space + ":table1 <urn:x:seen> 3 . :table1 s:x 3 .")
    with pytest.raises(semmap.WorldError, match="follows from"):
        flat.import_rdf(path)
    path.write_text(space + ":table1 <urn:x:seen> 3, 4 .")
    assert flat.import_rdf(path) == 2
    assert sorted(flat.sparql("SELECT ?n { :table1 <urn:x:seen> ?n }")) == [(3,), (4,)]
    for call in (flat.import_rdf, flat.export_rdf):
        with pytest.raises(ValueError, match=r"ending '\.xyz' is not one of \.ttl"):
            call(tmp_path / "facts.xyz")


def test_pushing_needs_a_relation_and_a_service(flat: semmap.Map) -> None:
    with pytest.raises(ValueError, match="name a relation"):
        flat.push_fields()
    with pytest.raises(ValueError, match="is computed when a query names it"):
        flat.push_fields({"sees": "semmap:sees"})
    with pytest.raises(ValueError, match="no service of flat is running"):
        flat.push_fields({"sees": "looksAt"})


def test_a_client_in_the_notation_of_knowledge_core(flat: semmap.Map) -> None:
    with flat.knowledge_client() as kb:
        kb += ["human1 looksAt table1"]
        assert kb.find(["who"], ["?who looksAt table1"]) == {"human1"}


def test_limits_are_numbers_above_zero(flat: semmap.Map) -> None:
    for seconds in (0, -1, float("inf"), float("nan")):
        with pytest.raises(ValueError, match=f"seconds is {seconds}: give a number above 0"):
            flat.sparql("ASK {}", seconds=seconds)
        with pytest.raises(ValueError, match="give a number above 0"):
            flat.reason(seconds=seconds)
    with pytest.raises(ValueError, match="rows is -1: give a number of at least 1"):
        flat.sparql("SELECT ?x { ?x a ?y }", rows=-1)
    assert flat.sparql("ASK {}", seconds=1e12)


def test_a_missing_folder_is_one_line_for_a_user(flat: semmap.Map, tmp_path: Path) -> None:
    url = flat.database.address
    done = semmap_process(url, "rdf", "export", tmp_path / "none" / "a.ttl")
    assert done.returncode == 2
    assert done.stderr == f"error: {tmp_path}/none/a.ttl: No such file or directory\n"
