"""The runner of the W3C's tests finds right and wrong answers, on tests written for it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import psycopg
import pytest

import semmap
from benchmarks.conformance import by_oxigraph, by_rdflib, by_semmap, cases, run
from benchmarks.conformance_failures import why
from benchmarks.conformance_graph_store import failed_steps
from benchmarks.conformance_protocol import CHECKS, protocol_client
from benchmarks.conformance_syntax import READERS, is_read, syntax_cases
from semmap.knowledge.map_view import MapView
from tests.conftest import MakeDatabase

MANIFEST = """
@prefix : <http://example.org/manifest#> .
@prefix mf: <http://www.w3.org/2001/sw/DataAccess/tests/test-manifest#> .
@prefix qt: <http://www.w3.org/2001/sw/DataAccess/tests/test-query#> .
@prefix ut: <http://www.w3.org/2009/sparql/tests/test-update#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
<> mf:entries (:rows :wrong-rows :yes :graph :added :not-added) .
:rows a mf:QueryEvaluationTest ; mf:result <rows.srx> ;
    mf:action [ qt:query <rows.rq> ; qt:data <data.ttl> ; qt:graphData <named.ttl> ] .
:wrong-rows a mf:QueryEvaluationTest ; mf:result <rows.srx> ;
    mf:action [ qt:query <rows.rq> ; qt:data <data.ttl> ] .
:yes a mf:QueryEvaluationTest ; mf:result <yes.srx> ;
    mf:action [ qt:query <yes.rq> ; qt:data <data.ttl> ] .
:graph a mf:QueryEvaluationTest ; mf:result <data.ttl> ;
    mf:action [ qt:query <graph.rq> ; qt:data <data.ttl> ] .
:added a mf:UpdateEvaluationTest ;
    mf:action [ ut:request <add.ru> ; ut:data <data.ttl> ] ;
    mf:result [ ut:data <data.ttl> ;
        ut:graphData [ ut:graph <data.ttl> ; rdfs:label "http://example.org/copy" ] ] .
:not-added a mf:UpdateEvaluationTest ;
    mf:action [ ut:request <add.ru> ; ut:data <data.ttl> ] ; mf:result [ ut:data <data.ttl> ] .
"""
HEAD = '<?xml version="1.0"?><sparql xmlns="http://www.w3.org/2005/sparql-results#">'
FILES = {
    "manifest.ttl": MANIFEST,
    "data.ttl": "@prefix : <http://example.org/> . :a :p 1.0 , _:x . _:x :p 'text'@en .",
    "named.ttl": "@prefix : <http://example.org/> . :a :q _:y .",
    "rows.rq": "PREFIX : <http://example.org/> SELECT ?s ?o "
    "{ ?s :p ?o GRAPH <named.ttl> { ?s :q ?y } }",
    "yes.rq": "PREFIX : <http://example.org/> ASK { :a :p/:p ?x }",
    "graph.rq": "CONSTRUCT { ?s ?p ?o } WHERE { ?s ?p ?o }",
    "add.ru": "COPY DEFAULT TO <http://example.org/copy>",
    "yes.srx": f"{HEAD}<head/><boolean>true</boolean></sparql>",
    "rows.srx": f"""{HEAD}<head><variable name="s"/><variable name="o"/></head><results>
        <result><binding name="s"><uri>http://example.org/a</uri></binding><binding name="o">
        <literal datatype="http://www.w3.org/2001/XMLSchema#decimal">1.00</literal></binding></result>
        <result><binding name="o"><bnode>n</bnode></binding>
        <binding name="s"><uri>http://example.org/a</uri></binding></result></results></sparql>""",
}


@pytest.fixture(scope="module")
def empty(make_database: MakeDatabase) -> Iterator[psycopg.Connection]:
    url = make_database().set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(url, autocommit=True) as session:
        session.execute("SET search_path = semmap, public")
        session.execute("DELETE FROM type_parent; DELETE FROM semantic_type")
        session.execute("INSERT INTO map (name) VALUES ('empty'); SET semmap.map = 'empty'")
        yield session


def test_the_runner_tells_right_from_wrong(empty: psycopg.Connection, tmp_path: Path) -> None:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    found = list(cases(tmp_path))
    names = "rows wrong-rows yes graph added not-added"
    assert " ".join(case.name for case in found) == names
    for case in found:
        for engine in (lambda c: by_semmap(c, empty), by_rdflib, by_oxigraph):
            wrong = case.name in ("wrong-rows", "not-added")
            assert run(case, engine) == ("another result" if wrong else ""), case.name
    assert MapView.of(empty).session.execute("SELECT count(*) FROM statement").fetchone() == (0,)


TEXTS = """
@prefix : <http://example.org/manifest#> .
@prefix mf: <http://www.w3.org/2001/sw/DataAccess/tests/test-manifest#> .
<> mf:entries (:read :not-refused :updated :refused :not-read :not-updated) .
:read a mf:PositiveSyntaxTest11 ; mf:action <good.rq> .
:not-refused a mf:NegativeSyntaxTest11 ; mf:action <good.rq> .
:updated a mf:PositiveUpdateSyntaxTest11 ; mf:action <good.ru> .
:refused a mf:NegativeSyntaxTest ; mf:action <bad.rq> .
:not-read a mf:PositiveSyntaxTest ; mf:action <bad.rq> .
:not-updated a mf:NegativeUpdateSyntaxTest11 ; mf:action <good.ru> .
"""


def test_texts_that_are_read_are_told_from_others(tmp_path: Path) -> None:
    (tmp_path / "manifest.ttl").write_text(TEXTS)
    (tmp_path / "good.rq").write_text("SELECT * { ?s <p> ?o }")
    (tmp_path / "good.ru").write_text("INSERT DATA { <s> <p> 1 }")
    (tmp_path / "bad.rq").write_text("SELECT { ?s <p> ?o }")
    wrong = {"not-refused", "not-read", "not-updated"}
    for reader in READERS.values():
        found = {case.name for case in syntax_cases(tmp_path) if is_read(case, reader)}
        assert found == wrong


def test_the_endpoint_answers_as_the_protocol_asks(make_database: MakeDatabase) -> None:
    url = make_database().render_as_string(hide_password=False)
    with semmap.connect(url) as database:
        database.create_map("flat")
        with protocol_client(database, "flat") as client:
            failed = [name for name, check in CHECKS.items() if not check(client)]
            not_stored = list(failed_steps(client))
    assert [name for name in failed if why(f"protocol/{name}") is None] == []
    assert len(failed) < 2
    assert [name for name in not_stored if why(f"graph-store/{name}") is None] == []
    assert len(not_stored) < 3
