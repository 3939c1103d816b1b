"""Requests for the W3C's tests of the SPARQL 1.1 protocol, which its manifest only names."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from starlette.testclient import TestClient

from benchmarks.conformance_manifest import MF, entries
from semmap import Database
from semmap.server.http_api import HttpApi

__all__ = ["CHECKS", "protocol_client", "protocol_tests"]

_TOKEN = "w" * 20
_ONE, _TWO, _NEW = (f"http://example.org/{name}" for name in ("one", "two", "new"))
_FIRST, _SECOND = "?s <urn:p> 1", "?s <urn:p> 2"
_QUERY_TYPE = {"Content-Type": "application/sparql-query"}
_UPDATE_TYPE = {"Content-Type": "application/sparql-update"}

Graphs = tuple[tuple[str, str], ...]
Check = Callable[[TestClient], bool]
"""Sends requests; returns whether the answers are those that the protocol asks for."""


@contextmanager
def protocol_client(database: Database, name: str) -> Iterator[TestClient]:
    """Yield a client of a map that has the graphs of the tests."""
    headers = {"Authorization": f"Bearer {_TOKEN}"}
    app = HttpApi(database, {_TOKEN: "semmap_robot"}).app
    with TestClient(app, f"http://localhost/maps/{name}/rdf", headers=headers) as client:
        for graph, number in ((_ONE, 1), (_TWO, 2)):
            _update(client, f"INSERT DATA {{ GRAPH <{graph}> {{ <urn:a> <urn:p> {number} }} }}")
        yield client


def protocol_tests(folder: Path) -> list[str]:
    """Return the names of the protocol tests of all manifests below a folder."""
    found = entries(folder, {MF.ProtocolTest})
    return [str(test).rsplit("#", 1)[-1] for _, test, _ in found]


def _update(client: TestClient, text: str, graphs: Graphs = ()) -> Any:
    return client.post("/update", params=graphs, content=text, headers=_UPDATE_TYPE)


def _is_true(answer: Any) -> bool:
    return bool(answer.status_code == 200 and answer.json()["boolean"])


def _is_refused(answer: Any) -> bool:
    return bool(400 <= answer.status_code < 500)


def _asks(pattern: str, graphs: Graphs, *, by_post: bool = False, dataset: str = "") -> Check:
    """Return the check that a pattern matches the graphs of a request."""
    pairs = (("query", f"ASK {dataset} {{ {pattern} }}"), *graphs)

    def check(client: TestClient) -> bool:
        if by_post:
            sent = client.post("/sparql", params=graphs, data={"query": pairs[0][1]})
        else:
            sent = client.get("/sparql", params=pairs)
        return _is_true(sent)

    return check


def _inserts(pattern: str, graphs: Graphs) -> Check:
    """Return the check that an update matches a pattern with the graphs of its request."""

    def check(client: TestClient) -> bool:
        _update(client, f"DELETE WHERE {{ GRAPH <{_NEW}> {{ ?s ?p ?o }} }}")
        text = f"INSERT {{ GRAPH <{_NEW}> {{ ?s <urn:found> true }} }} WHERE {{ {pattern} }}"
        sent = _update(client, text, graphs)
        return sent.is_success and _asks(f"GRAPH <{_NEW}> {{ ?s <urn:found> true }}", ())(client)

    return check


def _has_type(text: str, *kinds: str) -> Check:
    def check(client: TestClient) -> bool:
        sent = client.get("/sparql", params={"query": text})
        return sent.headers["content-type"].split(";")[0] in kinds

    return check


def _has_base(client: TestClient) -> bool:
    _update(client, f"INSERT DATA {{ GRAPH <{_NEW}> {{ <relative> <urn:p> 3 }} }}")
    return _asks('GRAPH ?g { ?s <urn:p> 3 FILTER(REGEX(STR(?s), "^http:")) }', ())(client)


_BOTH_DEFAULT = (("default-graph-uri", _ONE), ("default-graph-uri", _TWO))
_BOTH_NAMED = (("named-graph-uri", _ONE), ("named-graph-uri", _TWO))
_BOTH = f"{_FIRST} . {_SECOND}"
_EACH_NAMED = f"GRAPH <{_ONE}> {{ {_FIRST} }} GRAPH <{_TWO}> {{ {_SECOND} }}"
_FULL = f"{_FIRST} GRAPH ?g {{ {_SECOND} }} FILTER NOT EXISTS {{ {_SECOND} }}"
_TABLES = (
    "application/sparql-results+xml",
    "application/sparql-results+json",
    "text/csv",
    "text/tab-separated-values",
)
_GRAPHS = ("application/rdf+xml", "text/turtle", "application/n-triples")
_FORM = {"Content-Type": "application/x-www-form-urlencoded"}
_TEXT = {"Content-Type": "text/plain"}
_INSERTED = "INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:p> 4 } }"
_WITH = f"WITH <{_ONE}> DELETE {{ {_FIRST} }} WHERE {{ {_FIRST} }}"

CHECKS: Mapping[str, Check] = {
    "query_get": _asks("", ()),
    "query_post_form": _asks("", (), by_post=True),
    "query_post_direct": lambda c: _is_true(
        c.post("/sparql", content="ASK {}", headers=_QUERY_TYPE)
    ),
    "query_dataset_default_graphs_get": _asks(_BOTH, _BOTH_DEFAULT),
    "query_dataset_default_graphs_post": _asks(_BOTH, _BOTH_DEFAULT, by_post=True),
    "query_dataset_named_graphs_get": _asks(_EACH_NAMED, _BOTH_NAMED),
    "query_dataset_named_graphs_post": _asks(_EACH_NAMED, _BOTH_NAMED, by_post=True),
    "query_dataset_full": _asks(_FULL, (_BOTH_DEFAULT[0], _BOTH_NAMED[1])),
    "query_multiple_dataset": _asks(_FIRST, _BOTH_DEFAULT[:1], dataset=f"FROM <{_TWO}>"),
    "query_content_type_select": _has_type("SELECT (1 AS ?x) {}", *_TABLES),
    "query_content_type_ask": _has_type("ASK {}", *_TABLES[:2]),
    "query_content_type_describe": _has_type("DESCRIBE <urn:a>", *_GRAPHS),
    "query_content_type_construct": _has_type("CONSTRUCT { <urn:a> <urn:p> 1 } {}", *_GRAPHS),
    "update_dataset_default_graph": _inserts(_FIRST, (("using-graph-uri", _ONE),)),
    "update_dataset_default_graphs": _inserts(
        _BOTH, (("using-graph-uri", _ONE), ("using-graph-uri", _TWO))
    ),
    "update_dataset_named_graphs": _inserts(
        _EACH_NAMED, (("using-named-graph-uri", _ONE), ("using-named-graph-uri", _TWO))
    ),
    "update_dataset_full": _inserts(
        _FULL, (("using-graph-uri", _ONE), ("using-named-graph-uri", _TWO))
    ),
    "update_post_form": lambda c: c.post("/update", data={"update": _INSERTED}).is_success,
    "update_post_direct": lambda c: _update(c, _INSERTED).is_success,
    "update_base_uri": _has_base,
    "bad_query_method": lambda c: _is_refused(c.put("/sparql", params={"query": "ASK {}"})),
    "bad_multiple_queries": lambda c: _is_refused(
        c.get("/sparql", params=[("query", "ASK {}"), ("query", "SELECT * {}")])
    ),
    "bad_query_wrong_media_type": lambda c: _is_refused(
        c.post("/sparql", content="ASK {}", headers=_TEXT)
    ),
    "bad_query_missing_form_type": lambda c: _is_refused(
        c.post("/sparql", content="query=ASK%20%7B%7D")
    ),
    "bad_query_missing_direct_type": lambda c: _is_refused(c.post("/sparql", content="ASK {}")),
    "bad_query_non_utf8": lambda c: _is_refused(
        c.post("/sparql", content="ASK {}".encode("utf-16"), headers=_QUERY_TYPE)
    ),
    "bad_query_syntax": lambda c: _is_refused(c.get("/sparql", params={"query": "ASK {"})),
    "bad_update_get": lambda c: _is_refused(c.get("/update", params={"update": _INSERTED})),
    "bad_multiple_updates": lambda c: _is_refused(
        c.post("/update", params={"update": _INSERTED}, data={"update": _INSERTED})
    ),
    "bad_update_wrong_media_type": lambda c: _is_refused(
        c.post("/update", content=_INSERTED, headers=_TEXT)
    ),
    "bad_update_missing_form_type": lambda c: _is_refused(
        c.post("/update", content="update=CLEAR%20SILENT%20NAMED")
    ),
    "bad_update_non_utf8": lambda c: _is_refused(
        c.post("/update", content=_INSERTED.encode("utf-16"), headers=_UPDATE_TYPE)
    ),
    "bad_update_syntax": lambda c: _is_refused(_update(c, "INSERT DATA {")),
    "bad_update_dataset_conflict": lambda c: _is_refused(
        _update(c, _WITH, (("using-graph-uri", _ONE),))
    ),
}
