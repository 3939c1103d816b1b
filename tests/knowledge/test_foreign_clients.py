"""Browsers, and clients of others, use the endpoint as they use any other one."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import httpx
import pyhornedowl
import pyoxigraph
import pytest
import rdflib
from pyhornedowl.model import ClassAssertion, SubClassOf
from rdflib.compare import isomorphic
from rdflib.namespace import RDF, VOID
from rdflib.plugins.stores.sparqlstore import SPARQLUpdateStore
from SPARQLWrapper import JSON, POST, SPARQLWrapper

from semmap import Map
from semmap.server.service_description import FORMAT, SD
from tests.knowledge.test_sparql_endpoint import ADMIN, QUERY, WRITER, bearer, serving

PAGE = "https://maps.example"
TURTLE = {"Content-Type": "text/turtle", **bearer(WRITER)}
SOFA = rdflib.URIRef("urn:semmap:map:loft#sofa")


@pytest.fixture(scope="module")
def client(loft_map: Map) -> Iterator[httpx.Client]:
    with serving(loft_map, seconds=20, rows=9000, origins=[PAGE]) as client:
        yield client


@pytest.mark.parametrize(("origin", "allowed"), [(PAGE, PAGE), ("https://other.example", None)])
def test_pages_of_some_origins_read_answers(
    client: httpx.Client, origin: str, allowed: str | None
) -> None:
    answer = client.get("/sparql", params={"query": QUERY}, headers={"Origin": origin})
    assert answer.headers.get("access-control-allow-origin") == allowed
    asked = {
        "Origin": origin,
        "Access-Control-Request-Method": "PUT",
        "Access-Control-Request-Headers": "authorization, content-type",
    }
    may = client.options("/graph", headers=asked)
    assert may.is_success == (allowed is not None)
    assert may.headers.get("access-control-allow-origin") == allowed
    if allowed:
        assert "authorization" in may.headers["access-control-allow-headers"].lower()


def test_answers_are_packed_where_the_client_unpacks(client: httpx.Client) -> None:
    def raw(encoding: str) -> tuple[str | None, bytes]:
        headers = {"Accept": "text/turtle", "Accept-Encoding": encoding}
        with client.stream("GET", "/graph?default=", headers=headers) as answer:
            return answer.headers.get("content-encoding"), b"".join(answer.iter_raw())

    how, packed = raw("gzip")
    plain, text = raw("identity")
    assert (how, plain) == ("gzip", None)
    assert gzip.decompress(packed) == text
    assert len(packed) < len(text) / 3


def test_an_unchanged_answer_is_not_sent_again(client: httpx.Client) -> None:
    name = {"graph": "http://example.org/tagged"}
    client.put("/graph", params=name, content="<urn:a> <urn:b> 1 .", headers=TURTLE)
    first = client.get("/graph", params=name)
    known = {"If-None-Match": f'"other", {first.headers["etag"]}'}
    again = client.get("/graph", params=name, headers=known)
    assert (again.status_code, again.content) == (304, b"")
    assert client.get("/graph", params=name, headers={"If-None-Match": '"x"'}).text == first.text
    assert client.get("/graph", params=name, headers={"If-None-Match": "*"}).status_code == 304
    xml = client.get("/graph", params=name, headers={**known, "Accept": "application/rdf+xml"})
    assert xml.status_code == 200
    client.post("/graph", params=name, content="<urn:a> <urn:b> 2 .", headers=TURTLE)
    assert client.get("/graph", params=name, headers=known).status_code == 200
    client.delete("/graph", params=name, headers=TURTLE)


def test_an_answer_that_time_changes_is_sent_again(client: httpx.Client, loft_map: Map) -> None:
    loft_map.knowledge_client().add(["bob <http://e/mood> 5"], lifespan=1)
    asked = {"query": "SELECT ?x { ?x <http://e/mood> ?y }"}
    first = client.get("/sparql", params=asked)
    known = {"If-None-Match": first.headers["etag"]}
    assert first.json()["results"]["bindings"]
    while client.get("/sparql", params=asked).json()["results"]["bindings"]:
        pass
    assert client.get("/sparql", params=asked, headers=known).status_code == 200


def test_the_endpoint_describes_itself(client: httpx.Client) -> None:
    name = {"graph": "http://example.org/described"}
    client.put("/graph", params=name, content="<urn:a> <urn:b> 1, 2 .", headers=TURTLE)
    answer = client.get("/sparql", headers={"Accept": "application/rdf+xml"})
    client.delete("/graph", params=name, headers=TURTLE)
    found = rdflib.Graph().parse(data=answer.text, format="xml")
    url = rdflib.URIRef(f"{client.base_url}sparql")
    assert found.value(url, RDF.type) == SD.Service
    spoken = found[: SD.supportedLanguage]
    languages = {word: at for one, word in spoken for at in found[one : SD.endpoint]}
    update = rdflib.URIRef(f"{client.base_url}update")
    assert languages == {SD.SPARQL11Query: url, SD.SPARQL11Update: update}
    data = found.value(url, SD.defaultDataset)
    assert set(found[data : RDF.type]) == {SD.Dataset, VOID.Dataset}
    assert str(found.value(data, VOID.uriSpace)) == "urn:semmap:map:loft#"
    (named,) = found[: SD.name : rdflib.URIRef(name["graph"])]
    assert [n.toPython() for n in found[named : SD.graph / VOID.triples]] == [2]
    media = {
        "SPARQL_Results_JSON": "application/sparql-results+json",
        "SPARQL_Results_XML": "application/sparql-results+xml",
        "SPARQL_Results_CSV": "text/csv",
        "SPARQL_Results_TSV": "text/tab-separated-values",
        "Turtle": "text/turtle",
        "N-Triples": "application/n-triples",
        "JSON-LD": "application/ld+json",
        "RDF_XML": "application/rdf+xml",
    }
    assert set(found[url : SD.resultFormat]) == {FORMAT[each] for each in media}
    for each, kind in media.items():
        text = QUERY if each.startswith("SPARQL") else "CONSTRUCT WHERE { ?s a semmap:Sofa }"
        got = client.get("/sparql", params={"query": text}, headers={"Accept": kind})
        assert got.headers["content-type"].split(";")[0] == kind


def test_a_new_graph_has_a_name_of_its_own(client: httpx.Client) -> None:
    body = "<urn:a> <urn:b> <#c> ."
    made = client.post("/graph", content=body, headers=TURTLE)
    assert made.status_code == 201
    at = made.headers["location"]
    assert at.startswith(f"{client.base_url}graph/")
    assert f"<{at}#c>" in client.get(at, headers={"Accept": "application/n-triples"}).text
    by_name = client.get(
        "/graph", params={"graph": at}, headers={"Accept": "application/n-triples"}
    )
    assert f"<{at}#c>" in by_name.text
    assert client.put(at, content="<urn:a> <urn:b> 2 .", headers=TURTLE).status_code == 204
    assert '"2"' in client.get(at, headers={"Accept": "application/n-triples"}).text
    assert client.head(at).status_code == 200
    assert client.delete(at).status_code == 401
    assert client.delete(at, headers=TURTLE).status_code == 204
    assert client.get(at).status_code == 404


@pytest.mark.parametrize("name", ["http://ex/日本", "urn:x:é"])
def test_a_graph_of_any_iri_is_made(client: httpx.Client, name: str) -> None:
    made = client.put(
        "/graph", params={"graph": name}, content="<urn:a> <urn:b> 1 .", headers=TURTLE
    )
    assert made.status_code == 201
    assert unquote(made.headers["location"]) == name
    assert client.get("/graph", params={"graph": name}).status_code == 200
    assert client.delete("/graph", params={"graph": name}, headers=TURTLE).status_code == 204
    broken = client.put("/graph", params={"graph": f"{name}\r\nX: y"}, content="", headers=TURTLE)
    assert broken.status_code == 400


def test_addresses_of_a_map_of_any_name(loft_map: Map) -> None:
    strange = "my house/日 #1"
    with serving(loft_map) as client:
        loft_map.database.create_map(strange)
        try:
            base = f"{str(client.base_url).removesuffix('loft/rdf/')}{quote(strange, safe='')}/rdf"
            described = client.get(f"{base}/sparql", headers={"Accept": "text/turtle"})
            found = rdflib.Graph().parse(data=described.text, format="turtle")
            assert set(found[: SD.endpoint : rdflib.URIRef(f"{base}/sparql")])
            assert client.head(f"{base}/sparql").status_code == 200
            at = client.post(f"{base}/graph", content="<#a> <urn:b> 1 .", headers=TURTLE)
            assert at.headers["location"].startswith(f"{base}/graph/")
            written = client.get(at.headers["location"], headers={"Accept": "text/turtle"})
            assert f"{at.headers['location']}#a" in written.text
            for name in ("a%20b", "a%23b", "a%2Fb"):
                own = f"{base}/graph/{name}"
                assert client.put(own, content="<> <urn:b> 1 .", headers=TURTLE).is_success
                triples = client.get(f"{own}?x=1", headers={"Accept": "application/n-triples"})
                assert triples.text.startswith(f"<{own}> ")
        finally:
            loft_map.database.drop_map(strange)


def test_blank_nodes_belong_to_a_file(client: httpx.Client) -> None:
    name = {"graph": "http://example.org/blank"}
    files = {k: (f"{k}.ttl", f"_:a <urn:{k}> 1 .", "text/turtle") for k in ("one", "two")}
    assert client.post("/graph", params=name, files=files, headers=bearer(WRITER)).is_success
    written = rdflib.Graph().parse(data=client.get("/graph", params=name).text, format="turtle")
    assert len(set(written.subjects())) == 2
    client.delete("/graph", params=name, headers=TURTLE)


def test_a_form_may_not_nest_nor_have_any_number_of_files(client: httpx.Client) -> None:
    name = {"graph": "http://example.org/many-files"}
    part = "--x\r\nContent-Type: {}\r\n\r\n{}\r\n"
    headers = {**bearer(WRITER), "Content-Type": "multipart/form-data; boundary=x"}
    for inner in (
        part.format("text/turtle", "<urn:a> <urn:b> 1 .") * 101,
        "".join(part.format(f"multipart/mixed; boundary=y{n}", f"--y{n}") for n in range(2)),
    ):
        sent = client.post("/graph", params=name, content=f"{inner}--x--\r\n", headers=headers)
        assert sent.status_code in (400, 415)


def test_files_of_a_form_are_one_graph(client: httpx.Client) -> None:
    name = {"graph": "http://example.org/form"}
    files = {
        "one": ("a.ttl", "<urn:a> <urn:b> 'ä' .", "text/turtle"),
        "two": ("b.nt", "<urn:a> <urn:b> <urn:c> .", "application/n-triples; charset=utf-8"),
    }
    made = client.post("/graph", params=name, files=files, headers=bearer(WRITER))
    assert made.status_code == 201
    written = rdflib.Graph().parse(data=client.get("/graph", params=name).text, format="turtle")
    wanted = rdflib.Graph().parse(data="<urn:a> <urn:b> 'ä', <urn:c> .", format="turtle")
    assert isomorphic(written, wanted)
    client.delete("/graph", params=name, headers=TURTLE)
    for wrong in (
        {"files": {"one": ("a.txt", "text", "text/plain")}},
        {"content": b"--x", "headers": {"Content-Type": "multipart/form-data; boundary=x"}},
        {"content": b"--x", "headers": {"Content-Type": "multipart/form-data"}},
    ):
        headers = {**bearer(WRITER), **wrong.pop("headers", {})}
        answer = client.post("/graph", params=name, headers=headers, **wrong)
        assert answer.status_code in (400, 415), answer.text
    assert client.get("/graph", params=name).status_code == 404


def test_unknown_names_are_noted(client: httpx.Client) -> None:
    answer = client.get("/sparql", params={"query": "ASK { ?x a semmap:Sofaa . :möbel ?p ?o }"})
    assert answer.json()["boolean"] is False
    notes = answer.headers.get_list("semmap-note")
    assert any("Sofaa" in each and "semmap:Sofa" in each for each in notes)
    broken = client.get("/sparql", params={"query": "ASK { ?s a <urn:semmap:type#a%0Ab%0D> }"})
    assert broken.json()["boolean"] is False
    assert "a b" in broken.headers["semmap-note"]
    assert "semmap-note" not in client.get("/sparql", params={"query": QUERY}).headers


def test_rdflib_reads_and_writes(client: httpx.Client) -> None:
    store = SPARQLUpdateStore(
        f"{client.base_url}sparql", f"{client.base_url}update", headers=bearer(ADMIN)
    )
    graph = rdflib.Graph(store, rdflib.graph.DATASET_DEFAULT_GRAPH_ID)
    label, text = rdflib.RDFS.comment, rdflib.Literal("grüner Bezug", lang="de")
    graph.add((SOFA, label, text))
    assert (SOFA, label, text) in graph
    text_of_sofa = f"CONSTRUCT {{ ?s ?p ?o }} WHERE {{ ?s ?p ?o FILTER(?s = <{SOFA}>) }}"
    made = rdflib.Graph(store).query(text_of_sofa)
    assert (SOFA, label, text) in made.graph
    graph.remove((SOFA, label, text))
    assert (SOFA, label, None) not in graph


def test_oxigraph_asks_it_as_a_service(client: httpx.Client) -> None:
    store = pyoxigraph.Store()
    sofa = pyoxigraph.NamedNode(str(SOFA))
    store.add(pyoxigraph.Quad(sofa, pyoxigraph.NamedNode("urn:of"), pyoxigraph.Literal("ann")))
    found = store.query(
        f"SELECT ?n ?who {{ ?s <urn:of> ?who SERVICE <{client.base_url}sparql> "
        "{ ?s <urn:semmap:ontology#name> ?n } }"
    )
    assert [(row["n"].value, row["who"].value) for row in found] == [("sofa", "ann")]


@pytest.mark.filterwarnings("ignore:ConjunctiveGraph")  # which SPARQLWrapper makes
def test_sparqlwrapper_asks_and_changes(client: httpx.Client) -> None:
    def asked(text: str, address: str = "sparql") -> SPARQLWrapper:
        wrapper = SPARQLWrapper(f"{client.base_url}{address}")
        wrapper.addCustomHttpHeader("Authorization", bearer(ADMIN)["Authorization"])
        wrapper.setQuery(text)
        return wrapper

    def told(verb: str) -> None:
        change = asked(f"{verb} DATA {{ <{SOFA}> rdfs:comment 'broad' }}", "update")
        change.setMethod(POST)
        change.query()

    told("INSERT")
    select = asked(f"SELECT ?c {{ <{SOFA}> rdfs:comment ?c }}")
    select.setReturnFormat(JSON)
    found: dict[str, Any] = select.queryAndConvert()
    assert [row["c"]["value"] for row in found["results"]["bindings"]] == ["broad"]
    # by default a graph is asked for as RDF/XML
    graph = asked("CONSTRUCT { ?s rdfs:comment ?c } WHERE { ?s rdfs:comment ?c }")
    assert (SOFA, rdflib.RDFS.comment, rdflib.Literal("broad")) in graph.queryAndConvert()
    told("DELETE")
    select.setQuery(f"ASK {{ <{SOFA}> rdfs:comment 'broad' }}")
    found = select.queryAndConvert()
    assert found["boolean"] is False


def test_an_owl_reader_reads_an_export(loft_map: Map, tmp_path: Path) -> None:
    """Horned-OWL reads RDF as the OWL API does, which Protégé is made with."""
    path = tmp_path / "loft.owl"
    loft_map.export_rdf(path)
    ontology = pyhornedowl.open_ontology_from_file(str(path), "rdf")
    found: dict[str, set[tuple[str, str]]] = {}
    for component in (each.component for each in ontology.get_components()):
        if isinstance(component, SubClassOf):
            found.setdefault("sub", set()).add((str(component.sub), str(component.sup)))
        elif isinstance(component, ClassAssertion):
            found.setdefault("is", set()).add((str(component.i), str(component.ce)))
    for kind, text in (
        ("sub", "SELECT ?a ?b { ?a rdfs:subClassOf ?b }"),
        ("is", "SELECT ?a ?b { ?a a ?b FILTER(?b != owl:Class) }"),
    ):
        assert found[kind] == {(str(a), str(b)) for a, b in loft_map.sparql(text).rows}
