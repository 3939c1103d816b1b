"""A SPARQL 1.1 protocol endpoint: query, update and graph store, over HTTP.

See www.w3.org/TR/sparql11-protocol and sparql11-http-rdf-update.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, quote
from uuid import uuid4

import psycopg
import rdflib
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from semmap.error import RightsError
from semmap.ingest.world import WorldError
from semmap.knowledge.facts import Fact, FactWriter, with_consequences
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import INFERRED_GRAPH
from semmap.knowledge.queries import KnowledgeError, limited, limited_view, query
from semmap.knowledge.rdf_file import parse_facts
from semmap.knowledge.results import RESULT_FORMATS, TRUTH_FORMATS
from semmap.knowledge.sparql.kept_queries import Session
from semmap.knowledge.sparql.scope import Chosen
from semmap.knowledge.updates import update
from semmap.knowledge.vocabulary import IRI, graph_iri, graph_names, prefixes
from semmap.knowledge.whole_graph import facts, serialized, with_prefixes
from semmap.language.error import QueryError
from semmap.limits import RDF_CHARACTERS
from semmap.server.handles import Handles
from semmap.server.requests import address_of, body_of, client_of, files_of, map_of
from semmap.server.service_description import service_description
from semmap.server.turns import Turns

GRAPH_FORMATS = {
    "text/turtle": "turtle",
    "application/n-triples": "nt",
    "application/ld+json": "json-ld",
    "application/rdf+xml": "xml",
    "application/trig": "trig",
    "application/n-quads": "nquads",
}
"""Media types of graphs with rdflib's names, the default first."""

MOST_BYTES = 2**20
"""The most bytes of a request: a minute suffices to read and store so much Turtle."""


NOTE = "Semmap-Note"
"""The header of what an answer notes, such as a name that the map does not have."""

MOST_NOTE = 500  # characters of a header
_MARKS = "%/:?#[]@!$&'()*+,;=~"  # of an IRI, which its URL has, too

GRAPH_METHODS = ["GET", "HEAD", "PUT", "POST", "DELETE"]


class SparqlEndpoint:
    """The endpoint of each map; `role` gives the database role of a request."""

    def __init__(
        self,
        handles: Handles,
        role: Callable[[Request], str | None],
        turns: Turns,
        *,
        seconds: float,
        rows: int,
    ) -> None:
        self._handles, self._role, self._turns = handles, role, turns
        self._seconds, self._rows = seconds, rows
        self.routes = [
            Route("/sparql", self._sparql, methods=["GET", "POST"]),
            Route("/update", self._sparql, methods=["POST"]),
            Route("/prefixes", self._prefixes),
            *(
                Route(path, self._graph, methods=GRAPH_METHODS)
                for path in ("/graph", "/graph/{at:path}")
            ),
        ]

    async def _sparql(self, request: Request) -> Response:
        if request.method in ("GET", "HEAD") and not request.query_params:
            return await self._in_turn(request, "", lambda: self._described(request))
        kind, text, dataset = await _read(request)
        if kind == "update":
            self._writer(request)
        of = self._update if kind == "update" else self._query
        return await self._in_turn(request, text, lambda: of(request, text, dataset))

    def _query(self, request: Request, text: str, dataset: Chosen | None) -> Response:
        with self._session(request) as session:
            answer = query(session, text, seconds=self._seconds, rows=self._rows, dataset=dataset)
        accept = request.headers.get("accept", "*/*")
        if answer.graph is not None:
            response = _as_graph(request, answer.graph)
        else:
            kind = _chosen(accept, RESULT_FORMATS if answer.form == "SELECT" else TRUTH_FORMATS)
            response = Response(RESULT_FORMATS[kind](answer), media_type=kind)
        for note in answer.notes:
            shown = "".join(each if each.isprintable() else " " for each in note)[:MOST_NOTE]
            response.headers.append(NOTE, shown.encode("ascii", "backslashreplace").decode())
        return response

    def _described(self, request: Request) -> Response:
        with self._session(request) as session:
            return _as_graph(request, service_description(session, address_of(request)))

    async def _prefixes(self, request: Request) -> Response:
        def known() -> Response:
            with self._session(request) as session:
                return JSONResponse(prefixes(MapView.of(session).name))

        return await self._in_turn(request, "", known)

    def _update(self, request: Request, text: str, dataset: Chosen | None) -> Response:
        try:
            with self._session(request) as session:
                changes = update(session, text, seconds=self._seconds, dataset=dataset)
        except QueryError as error:
            if isinstance(error.__cause__, psycopg.errors.InsufficientPrivilege):
                raise RightsError(str(error)) from error
            raise
        return JSONResponse({"added": changes.added, "removed": changes.removed})

    async def _graph(self, request: Request) -> Response:
        named = request.query_params.get("graph") or None
        is_new = request.method == "POST" and request.url.path.endswith("/graph")
        if "at" in request.path_params:  # its address is its name (section 4.1)
            named = address_of(request)
        elif is_new and not request.query_params:  # section 5.5
            named = f"{address_of(request)}/{uuid4()}"
        elif (named is None) == ("default" not in request.query_params):
            raise HTTPException(400, "name a graph: ?graph=IRI or ?default")
        if request.method in ("GET", "HEAD"):
            return await self._in_turn(request, "", lambda: self._read_graph(request, named))
        self._writer(request)
        if named is not None and request.method != "DELETE" and not IRI.fullmatch(named):
            raise HTTPException(400, f"{named!r} is not the IRI of a graph")
        if named is None and request.method != "POST":
            raise HTTPException(403, "the default graph is the map: it is not replaced")
        body = await body_of(request, MOST_BYTES)
        return await self._in_turn(request, body, lambda: self._write_graph(request, named, body))

    async def _in_turn(
        self, request: Request, text: str | bytes, answer: Callable[[], Response]
    ) -> Response:
        self._role(request)  # an unknown token has no turn
        what = (request.method, request.url.path, request.url.query, hash(text))
        response = await self._turns.run(client_of(request), what, answer)
        return _validated(request, response)

    def _read_graph(self, request: Request, named: str | None) -> Response:
        format_ = _chosen(request.headers.get("accept", "*/*"), GRAPH_FORMATS)
        with self._session(request) as session, limited(session, self._seconds):
            dataset = with_prefixes(rdflib.Dataset(), MapView.of(session).name)
            inferences = named == INFERRED_GRAPH
            wanted = None if named is None else graph_iri(named)
            for s, p, o, graph in facts(session, inferences=inferences):
                if (None if graph is None else str(graph)) == wanted:
                    dataset.default_graph.add((s, p, o))
                if len(dataset.default_graph) > self._rows:
                    raise KnowledgeError(
                        f"the graph has more than {self._rows:,} triples: query it"
                    )
        if named is not None and not len(dataset.default_graph):
            raise HTTPException(404, f"there is no graph <{named}>")
        return Response(serialized(dataset, GRAPH_FORMATS[format_]), media_type=format_)

    def _write_graph(self, request: Request, named: str | None, body: bytes) -> Response:
        method = request.method
        kind = request.headers.get("content-type", "text/turtle")
        new: list[Fact] = []
        if method != "DELETE":
            base = named or address_of(request)  # as the standard has it
            parsed = _parsed(files_of(kind, body), base)
            graph = None if named is None else rdflib.URIRef(named)
            new = [fact._replace(graph=graph) for fact in parsed]
        with self._session(request) as session, limited_view(session, self._seconds) as view:
            named_so = "graph IN (SELECT term_id(n) FROM unnest(%s::text[]) n)"
            stored = f"FROM triple WHERE map_id = %s AND {named_so}"
            of = (view.number, graph_names(named or ""))
            with with_consequences(view):
                if method == "POST":
                    row = session.execute(f"SELECT EXISTS (SELECT {stored})", of).fetchone()
                    existed = named is None or bool(row and row[0])
                else:
                    existed = session.execute(f"DELETE {stored}", of).rowcount > 0
                FactWriter(view).insert(new)
        if method == "DELETE" and not existed:
            raise HTTPException(404, f"there is no graph <{named}>")
        at = {"Location": quote(named, safe=_MARKS)} if named and not existed else None
        return Response(status_code=204 if existed else 201, headers=at)

    def _writer(self, request: Request) -> None:
        if self._role(request) is None:
            raise PermissionError("a change needs a token: Authorization: Bearer ...")

    @contextmanager
    def _session(self, request: Request) -> Iterator[Session]:
        with self._handles.lend(self._role(request)) as database:
            yield database.map(map_of(request)).connection


def _parsed(files: list[tuple[str, bytes]], base: str) -> list[Fact]:
    """Return the facts of files, which have one limit together."""
    found: list[Fact] = []
    characters = 0
    for type_, content in files:
        kind = type_.split(";")[0].strip().lower()
        if kind not in GRAPH_FORMATS:
            raise HTTPException(415, f"{kind} is not one of {', '.join(GRAPH_FORMATS)}")
        try:
            new = parse_facts(content.decode(), GRAPH_FORMATS[kind], Path("request"), base)
            characters += sum(len(term) for fact in new for term in fact[:3])
            RDF_CHARACTERS.check(
                characters, partial(WorldError, Path("request"), "file"), "Send fewer files."
            )
        except (WorldError, UnicodeDecodeError) as error:
            raise HTTPException(400, str(error)) from error
        found += new
    return found


def _as_graph(request: Request, graph: rdflib.Graph) -> Response:
    """Return an answer in the format that the client accepts of those without named graphs."""
    known = {kind: GRAPH_FORMATS[kind] for kind in list(GRAPH_FORMATS)[:4]}
    kind = _chosen(request.headers.get("accept", "*/*"), known)
    return Response(serialized(graph, known[kind]), media_type=kind)


def _validated(request: Request, response: Response) -> Response:
    """Name the content of an answer; a client that has it already gets 304.

    The content is compared, not a revision of the map: facts end by themselves.
    """
    if request.method not in ("GET", "HEAD") or response.status_code != 200:
        return response
    tag = f'W/"{sha256(bytes(response.body)).hexdigest()[:32]}"'
    headers = {"ETag": tag, "Vary": "Accept, Authorization"}
    known = request.headers.get("if-none-match", "")
    if {tag, "*"} & {each.strip() for each in known.split(",")}:
        return Response(status_code=304, headers=headers)
    response.headers.update(headers)
    return response


async def _read(request: Request) -> tuple[str, str, Chosen | None]:
    """Return kind, text and graphs of a request, however it was sent (sections 2.1 and 2.2)."""
    pairs = list(request.query_params.multi_items())
    kind = request.headers.get("content-type", "").split(";")[0].strip().lower()
    if request.method == "POST":
        try:
            body = (await body_of(request, MOST_BYTES)).decode()
        except UnicodeDecodeError as error:
            raise HTTPException(400, f"the request is not UTF-8: {error}") from error
        if kind == "application/x-www-form-urlencoded":
            pairs += parse_qsl(body, keep_blank_values=True)
        elif kind in ("application/sparql-query", "application/sparql-update"):
            pairs.append((kind.rsplit("-", 1)[1], body))
        else:
            raise HTTPException(
                415,
                "send application/sparql-query, application/sparql-update or "
                "application/x-www-form-urlencoded",
            )
    texts = [(name, value) for name, value in pairs if name in _DATASETS]
    if len(texts) != 1:
        raise HTTPException(400, "give one query, or one update")
    ((kind, text),) = texts
    if kind == "update" and request.method != "POST":
        raise HTTPException(405, "send an update by POST")
    return kind, text, _dataset(kind, pairs)


_DATASETS = {
    "query": ("default-graph-uri", "named-graph-uri"),
    "update": ("using-graph-uri", "using-named-graph-uri"),
}


def _dataset(of: str, pairs: list[tuple[str, str]]) -> Chosen | None:
    """Return the graphs that a request chooses (sections 2.1.4 and 2.2.3); None for the map."""
    given = {name for name, _ in pairs}
    for kind, names in _DATASETS.items():
        for name in given.intersection(names) if kind != of else ():
            raise HTTPException(400, f"{name} is not a parameter of a {of}")
    default, named = (tuple(v for n, v in pairs if n == name) for name in _DATASETS[of])
    for iri in (*default, *named):
        if not IRI.fullmatch(iri):
            raise HTTPException(400, f"{iri!r} is not the IRI of a graph")
    return Chosen(default, named) if default or named else None


def _chosen(accept: str, known: Mapping[str, Any]) -> str:
    wanted: list[tuple[float, int, str]] = []
    for position, part in enumerate(accept.split(",")):
        name, *options = (piece.strip() for piece in part.split(";"))
        quality = 1.0
        for option in options:
            if option.startswith("q="):
                try:
                    quality = float(option[2:])
                except ValueError:
                    quality = 0.0
        if quality > 0:
            wanted.append((-quality, position, name.lower()))
    for _, _, name in sorted(wanted):
        for each in known:
            if name in (each, "*/*", each.split("/")[0] + "/*"):
                return each
    raise HTTPException(406, f"the answer is one of {', '.join(known)}")
