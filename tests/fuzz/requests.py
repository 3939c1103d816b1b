"""HTTP requests to a server of maps, as text: method and target, headers, and a body."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import httpx
import rdflib
from starlette.testclient import TestClient

import semmap
from semmap.error import Error
from semmap.knowledge.whole_graph import without_warnings
from semmap.server.http_api import HttpApi
from tests.fuzz.kind import SERVER, Kind
from tests.fuzz.knowledge_files import FACTS
from tests.fuzz.mutate import bytes_of, lines_of, words_of
from tests.fuzz.server import ENDPOINT

TOKEN = "a-token-of-a-writer"
MAP = f"/maps/{ENDPOINT}/rdf"
GRAPH = f"{MAP}/graph?graph=http://example.org/told"
QUERIES = (
    "SELECT * { ?s a semmap:Room ; ?p ?o . FILTER (?o > 2) } ORDER BY ?o LIMIT 5",
    "CONSTRUCT { ?s ?p ?o } WHERE { GRAPH <http://example.org/told> { ?s ?p ?o } }",
    "ASK { ?s semmap:distance ?d }",
)
UPDATE = "INSERT DATA { GRAPH <http://example.org/told> { <urn:a> <urn:b> 1 } }"
ANSWERS = (
    *("text/turtle", "application/ld+json", "application/trig", "application/n-triples"),
    *("application/sparql-results+json", "text/csv", "application/rdf+xml", "*/*;q=0.5"),
)


def _request(first: str, body: bytes | str = "", **headers: str) -> bytes:
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    lines = (f"{name}: {value}" for name, value in named.items())
    written = body.encode() if isinstance(body, str) else body
    return "\n".join([first, f"Authorization: Bearer {TOKEN}", *lines, "", ""]).encode() + written


def requests() -> list[bytes]:
    """Requests of the graph store protocol and of SPARQL's, and of features and tiles."""
    told = rdflib.Graph()
    with without_warnings():
        told.parse(data=FACTS, format="turtle")
        bodies = {
            "text/turtle": FACTS.encode(),
            "application/ld+json": told.serialize(format="json-ld").encode(),
            "application/rdf+xml": told.serialize(format="xml").encode(),
            "application/n-triples": told.serialize(format="nt").encode(),
        }
    return [
        *(_request(f"PUT {GRAPH}", body, Content_Type=kind) for kind, body in bodies.items()),
        _request(f"POST {MAP}/graph?default", bodies["text/turtle"], Content_Type="text/turtle"),
        *(_request(f"GET {GRAPH}", Accept=kind) for kind in ANSWERS),
        _request(f"DELETE {GRAPH}"),
        *(
            _request(f"POST {MAP}/sparql", q, Content_Type="application/sparql-query")
            for q in QUERIES
        ),
        *(
            _request(f"GET {MAP}/sparql?{httpx.QueryParams(query=q)}", Accept="*/*")
            for q in QUERIES
        ),
        _request(f"POST {MAP}/update", UPDATE, Content_Type="application/sparql-update"),
        _request(f"GET /maps/{ENDPOINT}/collections/rooms/items?limit=3&bbox=0,0,5,5"),
        _request(f"GET /maps/{ENDPOINT}/collections/rooms/tiles/WebMercatorQuad/3/4/5"),
        _request(f"POST /maps/{ENDPOINT}/route", '{"start": [1, 1], "goal": "studio"}'),
    ]


class RefusedError(Error):
    """An answer of 4xx, or that the client refuses to send."""


@cache
def _client() -> TestClient:
    """A client of the application in this process; what it fails to answer is raised."""
    database = semmap.connect(os.environ[SERVER])
    app = HttpApi(database, {TOKEN: "semmap_admin"}, seconds=2).app
    return TestClient(app, base_url="http://127.0.0.1").__enter__()


def run_request(data: bytes, folder: Path) -> None:
    del folder
    head, _, body = data.partition(b"\n\n")
    first, *lines = head.decode("latin-1").split("\n")
    method, _, target = first.partition(" ")
    headers = [(n.encode("latin-1"), v.strip().encode("latin-1")) for n, _, v in map(_parts, lines)]
    try:
        request = _client().build_request(method, target, headers=headers, content=body)
    except Exception as error:  # of the client
        raise RefusedError(f"not sent: {error}") from error
    answer = _client().send(request)
    assert answer.status_code < 500 or answer.status_code == 503, answer.text[:500]
    if answer.status_code >= 400:
        assert answer.status_code in (405, 404) or answer.text, "a refusal without a text"
        raise RefusedError(f"{answer.status_code}: {answer.text[:200]}")


def _parts(line: str) -> tuple[str, str, str]:
    return line.partition(":")


REQUEST_KINDS = [Kind("request", requests, [bytes_of, words_of, words_of, lines_of], run_request)]
