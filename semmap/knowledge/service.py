"""A SPARQL 1.1 protocol endpoint: query, update and graph store, over HTTP.

See www.w3.org/TR/sparql11-protocol and sparql11-http-rdf-update. A request without a token is
answered by a role that only reads; a token names the role of another.
"""

from __future__ import annotations

import hmac
import json
import re
import select
import threading
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

import psycopg
import rdflib
import uvicorn
from psycopg import sql
from psycopg.pq import TransactionStatus
from sqlalchemy import Engine
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from semmap.database.maps import see_map
from semmap.database.parameters import SETTINGS
from semmap.ingest.world import WorldError
from semmap.knowledge.answer import Answer
from semmap.knowledge.facts import Fact, FactWriter, RefusedError, with_consequences
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import INFERRED_GRAPH
from semmap.knowledge.queries import KnowledgeError, limited, query
from semmap.knowledge.rdf_file import parse_facts
from semmap.knowledge.results import RESULT_FORMATS
from semmap.knowledge.shacl import BrokenShapeError
from semmap.knowledge.sparql.kept_queries import Session
from semmap.knowledge.sparql.scope import Chosen
from semmap.knowledge.updates import update
from semmap.knowledge.whole_graph import facts, serialized, with_prefixes
from semmap.language.error import QueryError

Connect = Callable[[], Session]

GRAPH_FORMATS = {
    "text/turtle": "turtle",
    "application/n-triples": "nt",
    "application/ld+json": "json-ld",
    "application/trig": "trig",
    "application/n-quads": "nquads",
}
"""Media types of graphs with rdflib's names, the default first."""

_IRI = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:[^\x00-\x20<>\"{}|^`\\]*")

MOST_IDLE = 8  # sessions that wait for each role; a session more is closed
PATIENCE = 5  # seconds that requests have to end when the server stops
MOST_BYTES = 16 * 2**20  # the most bytes of a request


class _ProtocolError(Exception):
    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


class SparqlEndpoint:
    """The endpoint of one map.

    `connect` opens a session that sees the map with the rights of a reader, `connect_writer` one
    whose login may take the roles of `tokens`; without tokens nobody may write.
    """

    def __init__(
        self,
        connect: Connect,
        connect_writer: Connect,
        tokens: Mapping[str, str] | None = None,
        *,
        seconds: float = 60,
        rows: int = 1_000_000,
    ) -> None:
        self._connect = connect
        self._connect_writer = connect_writer
        self._tokens = dict(tokens or {})
        self._seconds = seconds
        self._rows = rows
        self._idle = IdleSessions()
        self.app = Starlette(
            lifespan=self._lifespan,
            routes=[
                Route("/sparql", self._sparql, methods=["GET", "POST"]),
                Route("/update", self._sparql, methods=["POST"]),
                Route("/graph", self._graph, methods=["GET", "HEAD", "PUT", "POST", "DELETE"]),
            ],
            exception_handlers={_ProtocolError: _failure},
        )

    @asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        yield
        self.close()

    def close(self) -> None:
        """Close the sessions that wait."""
        self._idle.close()

    async def _sparql(self, request: Request) -> Response:
        kind, text, dataset = await _read(request)
        role = self._role(request)
        if kind == "update":
            if role is None:
                raise _ProtocolError(401, "an update needs a token: Authorization: Bearer ...")
            return await run_in_threadpool(self._update, text, role, dataset)
        accept = request.headers.get("accept", "*/*")
        return await run_in_threadpool(self._query, text, role, accept, dataset)

    def _query(self, text: str, role: str | None, accept: str, dataset: Chosen | None) -> Response:
        with self._session(role, write=False) as session, _reported():
            answer = query(session, text, seconds=self._seconds, rows=self._rows, dataset=dataset)
        return _answered(answer, accept)

    def _update(self, text: str, role: str, dataset: Chosen | None) -> Response:
        with self._session(role, write=True) as session, _reported():
            changes = update(session, text, seconds=self._seconds, dataset=dataset)
        return Response(
            json.dumps({"added": changes.added, "removed": changes.removed}),
            media_type="application/json",
        )

    async def _graph(self, request: Request) -> Response:
        named = request.query_params.get("graph")
        if (named is None) == ("default" not in request.query_params):
            raise _ProtocolError(400, "name a graph: ?graph=IRI or ?default")
        role = self._role(request)
        if request.method in ("GET", "HEAD"):
            accept = request.headers.get("accept", "*/*")
            return await run_in_threadpool(self._read_graph, named, role, accept)
        if role is None:
            raise _ProtocolError(401, "a change needs a token: Authorization: Bearer ...")
        if named is None and request.method != "POST":
            raise _ProtocolError(403, "the default graph is the map: it is not replaced")
        body = await _body(request)
        kind = request.headers.get("content-type", "text/turtle").split(";")[0].strip()
        return await run_in_threadpool(self._write_graph, request.method, named, role, body, kind)

    def _read_graph(self, named: str | None, role: str | None, accept: str) -> Response:
        format_ = _chosen(accept, GRAPH_FORMATS)
        with self._limited(role, write=False) as session:
            dataset = with_prefixes(rdflib.Dataset(), MapView.of(session).name)
            inferences = named == INFERRED_GRAPH
            for s, p, o, graph in facts(session, inferences=inferences):
                if (None if graph is None else str(graph)) == named:
                    dataset.default_graph.add((s, p, o))
        if named is not None and not len(dataset.default_graph):
            raise _ProtocolError(404, f"there is no graph <{named}>")
        return Response(serialized(dataset, GRAPH_FORMATS[format_]), media_type=format_)

    def _write_graph(
        self, method: str, named: str | None, role: str, body: bytes, kind: str
    ) -> Response:
        new: list[Fact] = []
        if method != "DELETE":
            if kind not in GRAPH_FORMATS:
                raise _ProtocolError(415, f"{kind} is not one of {', '.join(GRAPH_FORMATS)}")
            try:
                parsed = parse_facts(body.decode(), GRAPH_FORMATS[kind], Path("request"))
            except (WorldError, UnicodeDecodeError) as error:
                raise _ProtocolError(400, str(error)) from error
            graph = None if named is None else rdflib.URIRef(named)
            new = [fact._replace(graph=graph) for fact in parsed]
        with self._limited(role, write=True) as session:
            view = MapView.of(session)
            gone = 0
            with with_consequences(view):
                if method in ("PUT", "DELETE"):
                    gone = session.execute(
                        "DELETE FROM statement WHERE map_id = %s AND graph = %s",
                        (view.number, named),
                    ).rowcount
                FactWriter(view).insert(new)
        if method == "DELETE" and not gone:
            raise _ProtocolError(404, f"there is no graph <{named}>")
        return Response(status_code=204 if method == "DELETE" or gone else 201)

    def _role(self, request: Request) -> str | None:
        try:
            return role_of(request.headers.get("authorization"), self._tokens)
        except PermissionError as error:
            raise _ProtocolError(401, str(error)) from error

    @contextmanager
    def _session(self, role: str | None, *, write: bool) -> Iterator[Session]:
        """Lend a session with the rights of a role; those that only read are used again."""
        session = None if write else self._idle.take(role)
        if session is None:
            session = self._opened(role, write=write)
        try:
            yield session
        finally:
            if write or not self._idle.put(role, session):
                session.close()

    def _opened(self, role: str | None, *, write: bool) -> Session:
        session = self._connect() if role is None else self._connect_writer()
        try:
            if role is not None:
                # Statements are translated: none of them can take another role.
                session.execute(sql.SQL("SET ROLE {}").format(sql.Identifier(role)))
            if not write:
                session.execute("SET default_transaction_read_only = on")
            session.commit()
        except BaseException:
            session.close()
            raise
        return session

    @contextmanager
    def _limited(self, role: str | None, *, write: bool) -> Iterator[Session]:
        """Open a session for one transaction that ends in time."""
        with (
            self._session(role, write=write) as session,
            _reported(),
            limited(session, self._seconds),
        ):
            yield session


def serve(app: Starlette, host: str, port: int, stop: threading.Event | None = None) -> None:
    """Answer requests at an address, until `stop` is set, or the program is interrupted."""
    if not 0 <= port <= 65535:
        raise ValueError(f"port is {port}: give a number from 0 to 65535")
    config = uvicorn.Config(
        app, host=host, port=port, log_level="warning", timeout_graceful_shutdown=PATIENCE
    )
    server = uvicorn.Server(config)

    def end() -> None:
        assert stop is not None
        stop.wait()
        server.should_exit = True

    if stop is not None:
        threading.Thread(target=end, daemon=True).start()
    try:
        with suppress(KeyboardInterrupt):
            server.run()
    except SystemExit:
        raise ValueError(f"{host}:{port} cannot be used: choose another port or host") from None


def session_opener(engine: Engine, map_name: str) -> Connect:
    """Return a function that opens a session with an engine's login, which sees a map."""

    def connect() -> Session:
        _, arguments = engine.dialect.create_connect_args(engine.url)
        arguments.pop("context", None)  # of psycopg, not of the protocol
        settings = " ".join(f"-c {key}={value}" for key, value in SETTINGS.items())
        options = f"{arguments.pop('options', '')} {settings}".strip()
        session = psycopg.connect(**arguments, options=options)
        see_map(session, map_name, lasting=True)
        session.commit()
        return session

    return connect


def role_of(authorization: str | None, tokens: Mapping[str, str]) -> str | None:
    """Return the role of a header ``Bearer TOKEN``; None without one.

    PermissionError if the token is not known.
    """
    if authorization is None:
        return None
    scheme, _, token = authorization.partition(" ")
    if scheme.lower() == "bearer":
        for known, role in tokens.items():
            if hmac.compare_digest(known.encode(), token.strip().encode()):
                return role
    raise PermissionError("the token is not known")


def read_tokens(path: Path) -> dict[str, str]:
    """Return the roles of tokens: a file with a token and a role in each line."""
    if path.stat().st_mode & 0o077:
        raise ValueError(f"{path}: others can read it: chmod 600 {path}")
    tokens = {}
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) != 2 or len(words[0]) < 16:
            raise ValueError(
                f"{path}, line {number}: give a token of at least 16 characters and a role"
            )
        tokens[words[0]] = words[1]
    return tokens


async def _body(request: Request) -> bytes:
    parts, size = [], 0
    async for part in request.stream():
        size += len(part)
        if size > MOST_BYTES:
            raise _ProtocolError(413, f"the request has more than {MOST_BYTES:,} bytes")
        parts.append(part)
    return b"".join(parts)


async def _read(request: Request) -> tuple[str, str, Chosen | None]:
    """Return kind, text and graphs of a request, however it was sent (sections 2.1 and 2.2)."""
    pairs = list(request.query_params.multi_items())
    kind = request.headers.get("content-type", "").split(";")[0].strip().lower()
    if request.method == "POST":
        try:
            body = (await _body(request)).decode()
        except UnicodeDecodeError as error:
            raise _ProtocolError(400, f"the request is not UTF-8: {error}") from error
        if kind == "application/x-www-form-urlencoded":
            pairs += parse_qsl(body, keep_blank_values=True)
        elif kind in ("application/sparql-query", "application/sparql-update"):
            pairs.append((kind.rsplit("-", 1)[1], body))
        else:
            raise _ProtocolError(
                415,
                "send application/sparql-query, application/sparql-update or "
                "application/x-www-form-urlencoded",
            )
    texts = [(name, value) for name, value in pairs if name in _DATASETS]
    if len(texts) != 1:
        raise _ProtocolError(400, "give one query, or one update")
    ((kind, text),) = texts
    if kind == "update" and request.method != "POST":
        raise _ProtocolError(405, "send an update by POST")
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
            raise _ProtocolError(400, f"{name} is not a parameter of a {of}")
    default, named = (tuple(v for n, v in pairs if n == name) for name in _DATASETS[of])
    for iri in (*default, *named):
        if not _IRI.fullmatch(iri):
            raise _ProtocolError(400, f"{iri!r} is not the IRI of a graph")
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
    raise _ProtocolError(406, f"the answer is one of {', '.join(known)}")


def _answered(answer: Answer, accept: str) -> Response:
    if answer.graph is not None:
        kind = _chosen(accept, {k: GRAPH_FORMATS[k] for k in list(GRAPH_FORMATS)[:3]})
        return Response(serialized(answer.graph, GRAPH_FORMATS[kind]), media_type=kind)
    kind = _chosen(accept, RESULT_FORMATS)
    return Response(RESULT_FORMATS[kind](answer), media_type=kind)


@contextmanager
def _reported() -> Iterator[None]:
    """Report what is wrong with a request as the protocol has it (sections 2.1.6 and 2.2.4)."""
    try:
        yield
    except (QueryError, BrokenShapeError, RefusedError) as error:
        raise _ProtocolError(400, str(error)) from error
    except KnowledgeError as error:
        raise _ProtocolError(503, str(error)) from error
    except (psycopg.errors.InsufficientPrivilege, psycopg.errors.ReadOnlySqlTransaction) as error:
        raise _ProtocolError(403, str(error).splitlines()[0]) from error
    except psycopg.IntegrityError as error:
        raise _ProtocolError(400, error.diag.message_primary or str(error)) from error


async def _failure(_: Request, error: Exception) -> Response:
    assert isinstance(error, _ProtocolError)
    headers = {"WWW-Authenticate": "Bearer"} if error.status == 401 else {}
    return PlainTextResponse(error.reason + "\n", status_code=error.status, headers=headers)


class IdleSessions:
    """Sessions by role, the last used first."""

    def __init__(self) -> None:
        self._sessions: defaultdict[str | None, list[Session]] = defaultdict(list)
        self._lock = threading.Lock()
        self._closed = False

    def take(self, role: str | None) -> Session | None:
        """Return a session that can be used; None if none waits."""
        while True:
            with self._lock:
                if not self._sessions[role]:
                    return None
                session = self._sessions[role].pop()
            if _is_usable(session):
                return session
            session.close()

    def put(self, role: str | None, session: Session) -> bool:
        """Let a session wait; return whether it may."""
        with self._lock:
            waiting = self._sessions[role]
            if self._closed or len(waiting) >= MOST_IDLE or not _is_usable(session):
                return False
            waiting.append(session)
            return True

    def close(self) -> None:
        """Close all sessions that wait, and those that are put later."""
        with self._lock:
            self._closed = True
            for session in (s for sessions in self._sessions.values() for s in sessions):
                session.close()
            self._sessions.clear()


def _is_usable(session: Session) -> bool:
    """Return whether a session is between transactions, and its server has not left it."""
    if session.closed or session.info.transaction_status != TransactionStatus.IDLE:
        return False
    poll = select.poll()
    poll.register(session.fileno(), select.POLLIN)
    return not poll.poll(0)  # a server has nothing to say to an idle session but that it ends
