"""The maps over HTTP: operations, changes as server-sent events, OGC API - Features, OpenAPI.

Requests without a token have the rights of a reader; a token names the role of another.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from functools import partial
from importlib.metadata import version
from typing import Any
from urllib.parse import quote

import anyio
import psycopg
import sqlalchemy.exc
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.middleware.cors import CORSMiddleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import Mount, Route

from semmap.api.database import Database
from semmap.api.map import Map
from semmap.api.operations import OPERATIONS, Right
from semmap.database import DatabaseError
from semmap.draw.picture import Picture
from semmap.error import Error, InvalidArgumentError, RightsError, UnknownNameError
from semmap.knowledge.queries import KnowledgeError
from semmap.plain_values import plain
from semmap.query.map_events import MapEvent
from semmap.server import ogc_features as ogc
from semmap.server.calls import MOST, OperationCall, answered_at_once, offered
from semmap.server.handles import SECONDS, Handles
from semmap.server.layers import costs_of, grasps_of, moments_of, poses_of, voxels_of
from semmap.server.requests import EncodedSlashes, body_of, client_of, map_of, role_of
from semmap.server.scene import meshes_of, scene_of
from semmap.server.sparql_endpoint import NOTE, SparqlEndpoint
from semmap.server.turns import BusyError, Turns
from semmap.server.vector_tiles import MEDIA_TYPE, tile_of
from semmap.server.viewer_files import Viewer

MOST_LISTENERS = 32
"""The most clients that follow the changes at once."""

MOST_EVENTS = 10_000
"""The most events that wait for a client that does not read; then it is left."""

THIS_MACHINE = ["localhost", "127.0.0.1", "[::1]"]

MOST_BYTES = 2**20
"""The most bytes of a request."""

STATUS: dict[type[Exception], int] = {
    UnknownNameError: 404,
    RightsError: 403,
    BusyError: 503,
    KnowledgeError: 503,
    DatabaseError: 503,
    Error: 400,
    PermissionError: 401,
    psycopg.errors.InsufficientPrivilege: 403,
    psycopg.errors.ReadOnlySqlTransaction: 403,
    psycopg.IntegrityError: 400,
    psycopg.DataError: 400,
    psycopg.OperationalError: 503,
    sqlalchemy.exc.OperationalError: 503,
}
"""The HTTP status of each error."""

_AWAY = (DatabaseError, psycopg.OperationalError, sqlalchemy.exc.OperationalError)

RIGHTS: dict[str | None, tuple[Right, ...]] = {
    None: ("reader",),
    "semmap_reader": ("reader",),
    "semmap_robot": ("reader", "robot"),
}
"""The operations of each role; all others have all."""

_ALL: tuple[Right, ...] = ("reader", "robot", "admin")


class HttpApi:
    """The application for the maps of a database; `tokens` name the roles that may write.

    On this machine alone (`local`) requests need no token to read, and name this machine: a page
    of the web cannot reach the maps under a name of its own. Elsewhere each request has a token.
    A statement is stopped after `seconds`, an answer of SPARQL has at most `rows` (fewer where it
    has more than ten columns). Pages of the web at `origins` may read the answers.
    """

    def __init__(
        self,
        database: Database,
        tokens: Mapping[str, str] | None = None,
        *,
        local: bool = True,
        seconds: float = SECONDS,
        rows: int = int(MOST["rows"]),
        origins: Sequence[str] = (),
    ) -> None:
        self._tokens, self._local = dict(tokens or {}), local
        self._handles = Handles(database, seconds)
        self._turns = Turns()
        sparql = SparqlEndpoint(self._handles, self._role, self._turns, seconds=seconds, rows=rows)
        self._listeners: set[Callable[[], object]] = set()  # each ends one
        calls = answered_at_once(OPERATIONS)
        if not self._handles.reads_apart:
            calls.remove("Map.sql")
        most = MOST | {"seconds": seconds, "rows": rows}
        self._calls = {rights: offered(calls, rights, most) for rights in {*RIGHTS.values(), _ALL}}
        features: dict[str, Callable[[Map, str, Request], Any]] = {
            "": lambda _, base, request: ogc.landing(base, map_of(request)),
            "/conformance": lambda _, __, ___: {"conformsTo": ogc.CLASSES},
            "/collections": lambda _, base, __: ogc.collections(base),
            "/collections/{name}": lambda _, base, r: ogc.collection(base, r.path_params["name"]),
            "/collections/{name}/items": lambda map, base, request: ogc.items(
                map, request.path_params["name"], base, request.query_params
            ),
            "/collections/{name}/items/{id}": lambda map, base, request: ogc.item(
                map, request.path_params["name"], base, request.path_params["id"]
            ),
            "/collections/{name}/tiles/WebMercatorQuad/{z}/{y}/{x}": lambda map, _, r: tile_of(
                map, *(r.path_params[key] for key in ("name", "z", "y", "x"))
            ),
            "/scene": lambda map, _, __: scene_of(map),
            "/meshes.glb": lambda map, _, __: meshes_of(map),
            "/ways": self._ways,
            "/costs": lambda map, _, r: costs_of(
                map, r.query_params.get("robot") or None, "parts" in r.query_params
            ),
            "/moments": lambda map, _, __: moments_of(map),
            "/voxels": lambda map, _, r: voxels_of(map, r.query_params.get("text", "")),
            "/grasps": lambda map, _, r: grasps_of(map, r.query_params.get("name", "")),
            "/poses": lambda map, _, r: poses_of(map, r.query_params.get("at", "")),
        }
        self.app = Starlette(
            lifespan=self._lifespan,
            routes=[
                Route("/maps", self._maps),
                Route("/openapi.json", self._description),
                Route("/maps/{map}/openapi.json", self._description),
                Route("/maps/{map}/events", self._events),
                *(Route(f"/maps/{{map}}{path}", self._ogc(of)) for path, of in features.items()),
                Mount("/maps/{map}/rdf", routes=sparql.routes),
                Mount("/view", Viewer()),
                Route("/query", _query_page),
                Route("/maps/{map}/{operation}", self._operation, methods=["GET", "POST"]),
            ],
            middleware=[
                Middleware(
                    CORSMiddleware,
                    allow_origins=origins,
                    allow_methods=["*"],
                    allow_headers=["*"],
                    expose_headers=["ETag", "Location", "Retry-After", NOTE],
                ),
                Middleware(GZipMiddleware, compresslevel=4),
                Middleware(EncodedSlashes),
                *[Middleware(TrustedHostMiddleware, allowed_hosts=THIS_MACHINE)] * local,
            ],
            exception_handlers=dict.fromkeys(STATUS, _failure),
        )

    @asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        yield
        self._handles.close()

    def end_streams(self) -> None:
        """Let go of those who follow the changes, so that the server can stop."""
        for leave in [*self._listeners]:
            leave()

    async def _maps(self, request: Request) -> Response:
        role = self._role(request)
        found = await self._with(request, role, "", lambda db: db.list_maps())
        return JSONResponse(plain(found))

    async def _operation(self, request: Request) -> Response:
        role, name = self._role(request), request.path_params["operation"]
        call = self._calls[RIGHTS.get(role, _ALL)].get(name)
        if call is None:
            if name not in self._calls[_ALL]:
                raise UnknownNameError(f"no operation {name}: see /openapi.json")
            if role is None:
                raise PermissionError(f"{name} needs a token: Authorization: Bearer ...")
            raise RightsError(f"{role} may not {name}: see /openapi.json for what it may")
        if request.method == "GET" and call.operation.right != "reader":
            raise InvalidArgumentError(f"{name} changes the map: send it by POST")
        values = await _values(request, call)
        map_name = map_of(request)
        if name == "sql":
            role = None  # a statement could leave a role, but not the login of a reader
        found = await self._with(
            request, role, str(values), lambda db: call(db.map(map_name), values)
        )
        if isinstance(found, Picture):
            return Response(found.png, media_type="image/png")
        return JSONResponse(found)

    async def _events(self, request: Request) -> Response:
        role, map_name = self._role(request), map_of(request)
        since = request.headers.get("last-event-id") or request.query_params.get("since")
        if len(self._listeners) >= MOST_LISTENERS:
            raise BusyError(f"{MOST_LISTENERS} clients follow the changes: try again")
        loop = asyncio.get_running_loop()
        waiting: asyncio.Queue[MapEvent | None] = asyncio.Queue(MOST_EVENTS)

        def deliver(event: MapEvent | None) -> None:
            if waiting.full():  # the client does not read; it comes again with its last event
                event = None
                while not waiting.empty():
                    waiting.get_nowait()
            waiting.put_nowait(event)

        def begin() -> tuple[Database, Any]:
            handle = self._handles.open(role)
            try:
                return handle, handle.map(map_name).subscribe(
                    lambda event: loop.call_soon_threadsafe(deliver, event), since=since
                )
            except BaseException:
                handle.close()
                raise

        def end() -> None:
            try:
                with suppress(Error):  # the client has its events, and asks again
                    subscription.stop()
            finally:
                handle.close()

        handle, subscription = await run_in_threadpool(begin)
        leave = partial(loop.call_soon_threadsafe, deliver, None)
        self._listeners.add(leave)

        async def told() -> AsyncIterator[str]:
            try:
                yield ": the changes of the map, one event each\n\n"
                while True:
                    try:
                        event = await asyncio.wait_for(waiting.get(), 5)
                    except TimeoutError:
                        if not subscription.running:  # the map was dropped
                            return
                        yield ": still here\n\n"
                        continue
                    if event is None:
                        return
                    yield f"id: {event.cursor}\ndata: {json.dumps(plain(event))}\n\n"
            finally:
                self._listeners.discard(leave)
                with anyio.CancelScope(shield=True):  # also where the client has left
                    await run_in_threadpool(end)

        return StreamingResponse(told(), media_type="text/event-stream")

    async def _description(self, request: Request) -> Response:
        return JSONResponse(description(self._calls[RIGHTS.get(self._role(request), _ALL)]))

    def _ways(self, map: Map, _: str, request: Request) -> list[dict[str, Any]]:
        """The lines of a route with the arguments of `Map.route`."""
        call = self._calls[_ALL]["route"]
        asked = {word: call.read(word, text) for word, text in request.query_params.items()}
        ways: list[dict[str, Any]] = call.result(map, asked).ways()
        return ways

    def _ogc(self, of: Callable[[Map, str, Request], Any]) -> Callable[..., Any]:
        async def page(request: Request) -> Response:
            role, name = self._role(request), map_of(request)
            base = str(request.base_url.replace(path=f"/maps/{quote(name, safe='')}"))
            found = await self._with(request, role, "", lambda db: of(db.map(name), base, request))
            if isinstance(found, bytes):
                binary = MEDIA_TYPE if "/tiles/" in request.url.path else "model/gltf-binary"
                return Response(found, media_type=binary)
            kind = "application/geo+json" if "features" in found or "geometry" in found else None
            return JSONResponse(found, media_type=kind)

        return page

    async def _with(
        self, request: Request, role: str | None, text: str, answer: Callable[[Database], Any]
    ) -> Any:
        def answered() -> Any:
            with self._handles.lend(role) as database:
                return answer(database)

        return await self._turns.run(client_of(request), (str(request.url), hash(text)), answered)

    def _role(self, request: Request) -> str | None:
        role = role_of(request.headers.get("authorization"), self._tokens)
        if role is None and not self._local:
            raise PermissionError("each request needs a token: Authorization: Bearer ...")
        return role


def description(calls: Mapping[str, OperationCall]) -> dict[str, Any]:
    """The operations in OpenAPI 3.1."""
    at = {"name": "map", "in": "path", "required": True, "schema": {"type": "string"}}
    answers = {"200": {"description": "The answer."}, "default": {"description": "Why not."}}
    paths = {
        f"/maps/{{map}}/{call.name}": {
            "post": {
                "operationId": call.name,
                "summary": call.operation.help,
                "parameters": [at],
                "requestBody": {"content": {"application/json": {"schema": call.schema}}},
                "responses": answers,
            }
        }
        for call in calls.values()
    }
    title = {"title": "semmap", "version": version("semmap")}
    return {"openapi": "3.1.0", "info": title, "paths": paths}


async def _values(request: Request, call: OperationCall) -> dict[str, Any]:
    """The arguments of a request: of its query, or a JSON object in its body."""
    if request.method == "GET":
        return {word: call.read(word, text) for word, text in request.query_params.items()}
    body = await body_of(request, MOST_BYTES)
    try:
        values = json.loads(body or b"{}")
    except (ValueError, RecursionError) as error:
        raise InvalidArgumentError(f"the request is no JSON: {error}") from None
    if not isinstance(values, dict):
        raise InvalidArgumentError("the request is no JSON object: give arguments by their names")
    return values


async def _query_page(request: Request) -> Response:
    """The page lies beside the viewer, whose files it shares."""
    return RedirectResponse(f"view/query.html?{request.url.query}")


async def _failure(_: Request, error: Exception) -> Response:
    status = next(code for kind, code in STATUS.items() if isinstance(error, kind))
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else {}
    lines = [line for line in str(error).splitlines() if line.strip()]
    said = lines[0] if lines else type(error).__name__
    if isinstance(error, _AWAY):
        said = "the database does not answer: try again"  # not where it is, and who asks
    if status == 503 and not isinstance(error, KnowledgeError):
        headers["Retry-After"] = "1"
    said = said.encode(errors="backslashreplace").decode()  # it may name half a surrogate pair
    return JSONResponse({"error": said}, status, headers)
