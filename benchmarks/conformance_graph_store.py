"""Requests for the W3C's tests of the SPARQL 1.1 Graph Store HTTP Protocol, in their order.

A test finds the graphs that those before it left. Each graph is named by ``?graph=``, a new one by
its address; the W3C's requests name most by the path of the request. A status that the standard
allows instead passes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import rdflib
from rdflib.compare import isomorphic
from starlette.testclient import TestClient

from semmap.knowledge.facts import SKOLEM

__all__ = ["STEPS", "Step", "failed_steps"]

_ONE, _TWO = ({"graph": f"http://example.org/person/{name}.ttl"} for name in (1, 2))
_DEFAULT = {"default": ""}
_NEW: dict[str, str] = {}
"""By the address of the graph that was made last."""

_JOHN, _JANE, _ALICE = (f"[] <urn:card> '{name}' ." for name in ("John", "Jane", "Alice"))
_NAME, _FAMILY = "<urn:jane> <urn:name> 'Jane' .", "<urn:jane> <urn:family> 'Doe' ."
_RDF_XML = '<r:RDF xmlns:r="http://www.w3.org/1999/02/22-rdf-syntax-ns#"/>'
_SUCCESS = (200, 204)


@dataclass(frozen=True)
class Step:
    """A request of a test, and its answer: one of some statuses, and a graph in Turtle."""

    test: str
    method: str
    params: Mapping[str, str]
    statuses: tuple[int, ...]
    body: str | None = None
    graph: str | None = None
    files: Mapping[str, Any] | None = None

    def passes(self, client: TestClient, at: list[str]) -> bool:
        """Send the request; return whether the answer is that of the standard.

        `at` has the addresses of new graphs, and gets those that are made.
        """
        headers = {"Accept": "text/turtle"}
        if self.body is not None:
            headers["Content-Type"] = "text/turtle; charset=utf-8"
        answer = client.request(
            self.method,
            "/graph" if self.params is not _NEW else (at or ["/graph"])[-1],
            params=self.params,
            content=self.body,
            files=self.files,
            headers=headers,
        )
        if answer.status_code not in self.statuses:
            return False
        if not self.params and self.method == "POST" and "location" in answer.headers:
            at.append(answer.headers["location"])
        if self.method == "HEAD":
            return not answer.content
        return self.graph is None or isomorphic(_read(answer.text), _read(self.graph))


def _read(text: str) -> rdflib.Graph:
    """Return a graph with blank nodes for the IRIs that stored ones have (RDF 1.1, 3.5)."""
    found = rdflib.Graph()
    for triple in rdflib.Graph().parse(data=text, format="turtle"):
        s, p, o = (rdflib.BNode(str(t)) if str(t).startswith(SKOLEM) else t for t in triple)
        found.add((s, p, o))
    return found


_FILES = {"file": ("family.ttl", _FAMILY, "text/turtle")}

STEPS = (
    Step("put__initial_state", "PUT", _ONE, (201,), _JOHN),
    Step("get_of_put__initial_state", "GET", _ONE, (200,), graph=_JOHN),
    Step("put__graph_already_in_store", "PUT", _ONE, _SUCCESS, _JANE),
    Step("get_of_put__graph_already_in_store", "GET", _ONE, (200,), graph=_JANE),
    Step("put__default_graph", "PUT", _DEFAULT, (*_SUCCESS, 201), _ALICE),
    Step("get_of_put__default_graph", "GET", _DEFAULT, (200,), graph=_ALICE),
    Step("put__mismatched_payload", "PUT", _ONE, (400,), _RDF_XML),
    Step("delete__existing_graph", "PUT", _TWO, (201,), _JOHN),
    Step("delete__existing_graph", "DELETE", _TWO, _SUCCESS),
    Step("get_of_delete__existing_graph", "GET", _TWO, (404,)),
    Step("delete__nonexistent_graph", "DELETE", _TWO, (404,)),
    Step("post__existing_graph", "POST", _ONE, _SUCCESS, _NAME),
    Step("get_of_post__existing_graph", "GET", _ONE, (200,), graph=_JANE + _NAME),
    Step("post__multipart_formdata", "POST", _ONE, _SUCCESS, files=_FILES),
    Step("get_of_post__multipart_formdata", "GET", _ONE, (200,), graph=_JANE + _NAME + _FAMILY),
    Step("post__create__new_graph", "POST", {}, (201,), _ALICE),
    Step("get_of_post__create__new_graph", "GET", _NEW, (200,), graph=_ALICE),
    Step("post__empty_graph__existing_graph", "POST", _NEW, _SUCCESS, ""),
    Step("get_of_post__after_noop", "GET", _NEW, (200,), graph=_ALICE),
    Step("head_on_an_existing_graph", "HEAD", _ONE, (200,)),
    Step("head_on_a_nonexisting_graph", "HEAD", _TWO, (404,)),
)


def failed_steps(client: TestClient) -> Iterator[str]:
    """Send the requests; yield the names of the tests that fail."""
    at: list[str] = []
    yield from dict.fromkeys(step.test for step in STEPS if not step.passes(client, at))
