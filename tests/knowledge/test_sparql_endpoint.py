"""The endpoint answers as the SPARQL 1.1 protocol has it, with the rights of the token's role."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlencode

import httpx
import pytest
import rdflib

import semmap
from semmap import Map
from semmap.knowledge.whole_graph import without_warnings
from semmap.server.requests import read_tokens
from tests.served import served

WRITER, READER, ADMIN = "w" * 20, "r" * 20, "a" * 20
QUERY = "SELECT ?n { ?x a semmap:Sofa ; semmap:name ?n }"
XML = "{http://www.w3.org/2005/sparql-results#}"


@contextmanager
def serving(loft_map: Map, **options: float) -> Iterator[httpx.Client]:
    """A client of the protocol of the loft."""
    tokens = {WRITER: "semmap_robot", READER: "semmap_reader", ADMIN: "semmap_admin"}
    with (
        semmap.connect(loft_map.database.address) as database,
        served(database, tokens, **options) as url,
        httpx.Client(base_url=f"{url}/maps/loft/rdf", timeout=30) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def client(loft_map: Map) -> Iterator[httpx.Client]:
    with serving(loft_map, seconds=20, rows=9000) as client:
        yield client


def bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def test_a_query_is_sent_in_three_ways(client: httpx.Client) -> None:
    answers = [
        client.get("/sparql", params={"query": QUERY}),
        client.post("/sparql", data={"query": QUERY}),
        client.post("/sparql", content=QUERY, headers={"Content-Type": "application/sparql-query"}),
    ]
    for answer in answers:
        assert answer.status_code == 200, answer.text
        bindings = answer.json()["results"]["bindings"]
        assert bindings == [{"n": {"type": "literal", "value": "sofa"}}]


@pytest.mark.parametrize("accept", ["text/csv", "text/tab-separated-values"])
def test_a_truth_has_no_table(client: httpx.Client, accept: str) -> None:
    answer = client.get("/sparql", params={"query": "ASK {}"}, headers={"Accept": accept})
    assert (answer.status_code, "sparql-results+json" in answer.text) == (406, True)


@pytest.mark.parametrize(
    ("accept", "kind"),
    [
        ("*/*", "application/sparql-results+json"),
        ("text/csv;q=0.5, application/sparql-results+xml", "application/sparql-results+xml"),
        ("text/*", "text/csv"),
        ("text/tab-separated-values", "text/tab-separated-values"),
    ],
)
def test_the_format_of_the_answer_is_negotiated(
    client: httpx.Client, accept: str, kind: str
) -> None:
    answer = client.get("/sparql", params={"query": QUERY}, headers={"Accept": accept})
    assert answer.headers["content-type"].split(";")[0] == kind
    if kind.endswith("xml"):
        root = ET.fromstring(answer.text)
        assert [e.text for e in root.iter(f"{XML}literal")] == ["sofa"]
    else:
        assert "sofa" in answer.text


def test_formats_of_graphs(client: httpx.Client) -> None:
    text = "CONSTRUCT WHERE { ?x a semmap:Sofa ; semmap:heldBy ?y }"
    for accept, name in (("text/turtle", "turtle"), ("application/ld+json", "json-ld")):
        answer = client.get("/sparql", params={"query": text}, headers={"Accept": accept})
        with without_warnings():
            assert len(rdflib.Graph().parse(data=answer.text, format=name)) == 2
    refused = client.get("/sparql", params={"query": text}, headers={"Accept": "image/png"})
    assert refused.status_code == 406


@pytest.mark.parametrize(
    ("status", "request_"),
    [
        (400, {"params": {"format": "json"}}),
        (400, {"params": {"query": "SELECT ?x {"}}),
        (400, {"params": {"query": "SELECT ?y { ?x semmap:heldBy ?y } GROUP BY ?x"}}),
        (400, {"params": {"query": QUERY, "default-graph-uri": "no IRI"}}),
        (400, {"params": {"query": QUERY, "using-graph-uri": "http://a/b"}}),
        (405, {"params": {"update": "DELETE WHERE { ?s ?p ?o }"}}),
        (401, {"params": {"query": QUERY}, "headers": bearer("guess")}),
        (400, {"params": {"query": "SELECT * { SERVICE <http://a/b> { ?s ?p ?o } }"}}),
        (503, {"params": {"query": "SELECT * { ?a ?b ?c . ?d ?e ?f }"}}),
        (400, {"params": {"query": r"ASK { ?x semmap:name 'a\uD800' }"}}),
        (400, {"params": {"query": r"ASK { <http://a/\uD800> ?p ?o }"}}),
        (400, {"params": {"query": r"ASK { ?x semmap:name 'a\u0000' }"}}),
        (400, {"params": {"query": "ASK { FILTER(REGEX('abc', 'b', 'z')) }"}}),
        (400, {"params": {"query": "ASK { FILTER(REGEX('abc', 'b', 'n')) }"}}),
    ],
)
def test_wrong_requests(client: httpx.Client, status: int, request_: dict) -> None:
    answer = client.get("/sparql", **request_)
    assert answer.status_code == status
    assert answer.text.strip()


ARCHIVE, BELIEVED = "http://example.org/archive", "urn:semmap:map:loft#ann_believes"


@pytest.mark.parametrize(
    ("text", "default", "named", "found"),
    [  # sections 2.1.4 of the protocol and 13.2 of SPARQL 1.1
        ("?s ex:likes ?v", (), (), {"tea", "Tee", "5", "2.5", "true", "coffee", "cup%201"}),
        ("?s ex:likes ?v", (ARCHIVE,), (), {"juice"}),
        ("?s ex:likes ?v", (ARCHIVE, BELIEVED), (), {"juice", "milk"}),
        ("?s ex:likes ?v", (), (ARCHIVE,), set()),
        ("GRAPH ?g { ?s ex:likes ?v }", (), (), {"juice", "milk"}),
        ("GRAPH ?g { ?s ex:likes ?v }", (ARCHIVE,), (), set()),
        ("GRAPH ?g { ?s ex:likes ?v }", (ARCHIVE,), (BELIEVED,), {"milk"}),
        ("GRAPH ?g { ?s ex:likes ?v }", (), (BELIEVED, ARCHIVE), {"juice", "milk"}),
        ("?s semmap:heldBy ?v", (BELIEVED,), (), {"sofa"}),
        ("?s ex:likes ?v", ("http://no/graph",), (), set()),
    ],
)
def test_a_request_chooses_the_dataset(
    client: httpx.Client,
    text: str,
    default: tuple[str, ...],
    named: tuple[str, ...],
    found: set[str],
) -> None:
    wanted = [("default-graph-uri", iri) for iri in default]
    wanted += [("named-graph-uri", iri) for iri in named]
    start = "PREFIX ex: <http://example.org/> SELECT ?v "
    asked = [("query", f"{start} {{ {text} }}"), *wanted]
    body = urlencode(asked)
    form = {"Content-Type": "application/x-www-form-urlencoded"}
    direct = {"Content-Type": "application/sparql-query"}
    answers = [
        client.get("/sparql", params=asked),
        client.post("/sparql", content=body, headers=form),
        client.post("/sparql", params=wanted, content=asked[0][1], headers=direct),
    ]
    if wanted:  # the dataset of the request is used, whatever the query has
        asked[0] = ("query", f"{start} FROM <http://a/b> FROM NAMED <{ARCHIVE}> {{ {text} }}")
        answers.append(client.get("/sparql", params=asked))
    for answer in answers:
        assert answer.status_code == 200, answer.text
        values = [row["v"]["value"] for row in answer.json()["results"]["bindings"]]
        assert {re.split("[/#]", value)[-1] for value in values} == found


def test_an_update_reads_the_dataset_of_its_request(client: httpx.Client) -> None:
    start = "PREFIX ex: <http://example.org/> "
    insert = start + "INSERT { GRAPH ex:copy { ?s ex:copied ?v } } WHERE { ?s ex:likes ?v }"
    copied = start + "SELECT ?v { GRAPH ex:copy { ?s ex:copied ?v } }"
    parameters = {"using-graph-uri": ARCHIVE}

    def send(text: str) -> httpx.Response:
        headers = {"Content-Type": "application/sparql-update", **bearer(WRITER)}
        return client.post("/update", params=parameters, content=text, headers=headers)

    try:
        assert send(insert).json() == {"added": 1, "removed": 0}
        rows = client.get("/sparql", params={"query": copied}).json()["results"]["bindings"]
        assert [row["v"]["value"] for row in rows] == ["juice"]
        for clause in ("USING <http://a/b> ", "USING NAMED <http://a/b> "):
            assert send(insert.replace("WHERE", f"{clause} WHERE")).status_code == 400
        assert send(insert.replace("INSERT", "WITH <http://a/b> INSERT")).status_code == 400
    finally:
        del parameters["using-graph-uri"]
        assert send("DROP GRAPH <http://example.org/copy>").status_code == 200


def test_a_query_that_takes_too_long_is_stopped(loft_map: Map) -> None:
    text = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"
    with serving(loft_map, seconds=0.2) as client:
        answer = client.get("/sparql", params={"query": text})
        assert answer.status_code == 503
        assert "0.2 s" in answer.text
        assert client.get("/sparql", params={"query": QUERY}).status_code == 200


SESSIONS = """
SELECT array_agg(pid ORDER BY pid) FROM pg_stat_activity
WHERE datname = current_database() AND pid <> pg_backend_pid() AND NOT pid = ANY (%s)
"""


def test_sessions_serve_many_queries_until_the_server_ends_them(loft_map: Map) -> None:
    session = loft_map.connection
    before = session.execute(SESSIONS, ([],)).fetchone()[0] or []

    def opened() -> list[int] | None:
        return session.execute(SESSIONS, (before,)).fetchone()[0]

    with serving(loft_map) as client:
        assert client.get("/sparql", params={"query": QUERY}).status_code == 200
        first = opened()
        for _ in range(3):
            assert client.get("/sparql", params={"query": QUERY}).status_code == 200
            assert client.get("/sparql", params={"query": "SELECT ?x {"}).status_code == 400
        assert opened() == first
        session.execute("SELECT pg_terminate_backend(pid, 10000) FROM unnest(%s) pid", (first,))
        assert client.get("/sparql", params={"query": QUERY}).json()["results"]["bindings"]
        assert not {*first} & {*opened()}


def test_changes_need_a_token_whose_role_may_make_them(client: httpx.Client) -> None:
    text = "INSERT DATA { :bob <http://example.org/mood> 'good' }"
    found = "ASK { :bob <http://example.org/mood> 'good' }"
    for headers, status in (({}, 401), (bearer(READER), 403), (bearer(WRITER), 200)):
        answer = client.post("/update", data={"update": text}, headers=headers)
        assert answer.status_code == status, answer.text
        truth = client.get("/sparql", params={"query": found}).json()["boolean"]
        assert truth == (status == 200)
    # a robot describes objects, but not the building
    text = "INSERT DATA { :studio prop:colour 'white' }"
    answer = client.post("/update", data={"update": text}, headers=bearer(WRITER))
    assert (answer.status_code, "rights of the role" in answer.text) == (403, True)
    assert client.get("/sparql", params={"query": "ASK { :studio prop:colour ?c }"}).json() == {
        "head": {},
        "boolean": False,
    }
    done = client.post(
        "/update",
        data={"update": "DELETE WHERE { :bob <http://example.org/mood> ?m }"},
        headers=bearer(WRITER),
    )
    assert done.json() == {"added": 0, "removed": 1}


def test_the_graph_store(client: httpx.Client) -> None:
    name = {"graph": "http://example.org/notes"}
    body = "<urn:semmap:map:loft#bob> <http://example.org/saw> <urn:semmap:map:loft#table>, 3 ."
    headers = {"Content-Type": "text/turtle", **bearer(WRITER)}
    assert client.get("/graph", params=name).status_code == 404
    assert client.put("/graph", params=name, content=body).status_code == 401
    assert client.put("/graph", params=name, content=body, headers=headers).status_code == 201
    again = client.put("/graph", params=name, content=body, headers=headers)
    assert again.status_code == 204 or again.status_code == 201
    written = client.get("/graph", params=name)
    assert len(rdflib.Graph().parse(data=written.text, format="turtle")) == 2
    wrong = client.post("/graph", params=name, content="not turtle", headers=headers)
    assert wrong.status_code == 400
    assert client.delete("/graph", params=name, headers=headers).status_code == 204
    assert client.delete("/graph", params=name, headers=headers).status_code == 404
    whole = client.get("/graph?default=", headers={"Accept": "application/n-triples"})
    assert "loft#sofa" in whole.text
    assert client.put("/graph?default=", content=body, headers=headers).status_code == 403


@pytest.mark.parametrize("name", ["no IRI", "noiri", "a<b>", "http://e/ a", "http://e/\0", ""])
def test_a_graph_is_named_by_an_iri(client: httpx.Client, name: str) -> None:
    body = "<urn:a> <urn:b> 'from the store' ."
    headers = {"Content-Type": "text/turtle", **bearer(WRITER)}
    for method in ("PUT", "POST"):
        answer = client.request(
            method, "/graph", params={"graph": name}, content=body, headers=headers
        )
        assert answer.status_code == 400, answer.text
    text = f"INSERT {{ GRAPH ?g {{ :bob :saw 1 }} }} WHERE {{ BIND(IRI('{name}') AS ?g) }}"
    answer = client.post("/update", data={"update": text}, headers=bearer(WRITER))
    assert answer.status_code == 400, answer.text
    found = client.get("/sparql", params={"query": "ASK { ?s ?p 'from the store' }"})
    assert found.json()["boolean"] is False


@pytest.mark.parametrize("named", ["no IRI", "urn:semmap:graph:no%20IRI"])
def test_a_stored_graph_that_no_iri_names_is_read_and_deleted(
    loft_map: Map, client: httpx.Client, named: str
) -> None:
    loft_map.execute(
        "INSERT INTO statement (map_id, subject, predicate, object, tag, graph) "
        "VALUES (current_map(), 'urn:a', 'urn:b', 'urn:c', 'I', 'no IRI')"
    )
    name = {"graph": named}
    assert client.get("/graph", params=name).status_code == 200
    assert client.delete("/graph", params=name, headers=bearer(ADMIN)).status_code == 204
    assert client.get("/graph", params=name).status_code == 404


@pytest.mark.parametrize("term", ["<http://e/a b>", r"'a\u0000'", r"'a\uD800'"])
def test_a_term_that_no_file_can_have_is_refused(client: httpx.Client, term: str) -> None:
    answer = client.put(
        "/graph?graph=http://e/terms",
        content=f"<http://e/s> <http://e/p> {term} .",
        headers={"Content-Type": "text/turtle", **bearer(WRITER)},
    )
    assert answer.status_code == 400, answer.text
    assert "not a" in answer.text or "is not turtle: Parser error at line 1" in answer.text


@pytest.mark.parametrize("method", ["PUT", "POST"])
def test_relative_iris_of_a_graph_are_relative_to_it(client: httpx.Client, method: str) -> None:
    name = {"graph": "http://e/f/g"}
    headers = {"Content-Type": "text/turtle", **bearer(WRITER)}
    body = "<s> <p> '1'^^<d> ."
    sent = client.request(method, "/graph", params=name, content=body, headers=headers)
    assert sent.is_success
    written = client.get("/graph", params=name, headers={"Accept": "application/n-triples"}).text
    assert written.strip() == '<http://e/f/s> <http://e/f/p> "1"^^<http://e/f/d> .'
    client.delete("/graph", params=name, headers=headers)


def test_the_graph_store_has_the_limits_of_queries(loft_map: Map) -> None:
    name = {"graph": "http://example.org/many"}
    headers = {"Content-Type": "text/turtle", **bearer(WRITER)}
    lines = [f"<urn:{n}> <urn:p> {n} .\n" for n in range(35_000)]
    with serving(loft_map, seconds=0.5, rows=20) as client:
        answer = client.put("/graph", params=name, content="".join(lines), headers=headers)
        assert (answer.status_code, "0.5 s" in answer.text) == (503, True)
        assert client.get("/graph", params=name).status_code == 404
        large = client.put("/graph", params=name, content=" " * 2**20 + lines[0], headers=headers)
        assert large.status_code == 413
        for status, many in ((200, 20), (503, 21)):
            client.put("/graph", params=name, content="".join(lines[:many]), headers=headers)
            assert client.get("/graph", params=name).status_code == status
        client.delete("/graph", params=name, headers=headers)


def test_a_file_of_tokens(tmp_path: Path) -> None:
    path = tmp_path / "tokens"
    path.write_text(f"# robots\n{WRITER} semmap_robot\n")
    path.chmod(0o600)
    assert read_tokens(path) == {WRITER: "semmap_robot"}
    path.write_text("short semmap_robot\n")
    with pytest.raises(ValueError, match="line 1"):
        read_tokens(path)
    path.chmod(0o644)
    with pytest.raises(ValueError, match="chmod"):
        read_tokens(path)
