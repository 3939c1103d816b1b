"""Resources of the Model Context Protocol: the changes of a map, and its entities.

Clients of 2026 listen, those of 2025 subscribe; both then read again what has changed.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from functools import partial
from typing import Any
from urllib.parse import quote, unquote

import anyio
from anyio.abc import TaskStatus
from mcp.server import ServerRequestContext
from mcp.server.session import ServerSession
from mcp.server.subscriptions import InMemorySubscriptionBus, ListenHandler, ResourceUpdated
from mcp.shared.exceptions import MCPError
from mcp_types import (
    INVALID_PARAMS,
    EmptyResult,
    ListResourcesResult,
    ListResourceTemplatesResult,
    PaginatedRequestParams,
    ReadResourceRequestParams,
    ReadResourceResult,
    Resource,
    ResourceTemplate,
    SubscribeRequestParams,
    TextResourceContents,
    UnsubscribeRequestParams,
)

from semmap.api.map import Map
from semmap.error import Error
from semmap.plain_values import plain
from semmap.query.map_events import MapEvent

CHANGES, ENTITY = "semmap://changes", "semmap://entities/"
MOST_CHANGES, MOST_WAITING = 20, 10_000
"""Changes in one answer, and changes that wait to be sent."""

Context = ServerRequestContext[Any]


class MapResources:
    """The resources of one map; `limiter` lets one thread at a time use it."""

    def __init__(self, map: Map, limiter: anyio.CapacityLimiter) -> None:
        self._map, self._limiter = map, limiter
        self._changes: deque[Any] = deque(maxlen=MOST_CHANGES)
        self._bus = InMemorySubscriptionBus()
        self._subscribed: dict[str, ServerSession] = {}  # of the one client
        self.handlers: dict[str, Any] = {
            "on_list_resources": self._list,
            "on_list_resource_templates": self._list_templates,
            "on_read_resource": self._read,
            "on_subscribe_resource": self._subscribe,
            "on_unsubscribe_resource": self._unsubscribe,
            "on_subscriptions_listen": ListenHandler(self._bus),
        }

    async def notify(self, *, task_status: TaskStatus[None] = anyio.TASK_STATUS_IGNORED) -> None:
        """Notify clients of changes of the map, until it is cancelled."""
        waiting: asyncio.Queue[MapEvent] = asyncio.Queue(MOST_WAITING)
        hear = partial(asyncio.get_running_loop().call_soon_threadsafe, partial(_put, waiting))
        subscription = await anyio.to_thread.run_sync(self._map.subscribe, hear)
        task_status.started()
        try:
            while True:
                await self._notify(await waiting.get())
        finally:
            with anyio.CancelScope(shield=True):
                await anyio.to_thread.run_sync(subscription.stop)

    async def _notify(self, event: MapEvent) -> None:
        self._changes.append(plain(event))
        uris = {CHANGES, *([ENTITY + quote(event.name, safe="")] if event.name else [])}
        for uri in uris:
            await self._bus.publish(ResourceUpdated(uri))
        for uri in uris & self._subscribed.keys():
            await self._subscribed[uri].send_resource_updated(uri)

    async def _list(self, _: Context, __: PaginatedRequestParams | None) -> ListResourcesResult:
        what = f"The last {MOST_CHANGES} changes since the server began, the newest last."
        about = Resource(uri=CHANGES, name="changes", description=what, mime_type=_JSON)
        return ListResourcesResult(resources=[about])

    async def _list_templates(
        self, _: Context, __: PaginatedRequestParams | None
    ) -> ListResourceTemplatesResult:
        about = ResourceTemplate(
            uri_template=f"{ENTITY}{{name}}",
            name="entity",
            description="All that describe tells of an entity.",
            mime_type=_JSON,
        )
        return ListResourceTemplatesResult(resource_templates=[about])

    async def _read(self, _: Context, params: ReadResourceRequestParams) -> ReadResourceResult:
        uri = params.uri
        if uri == CHANGES:
            found: Any = [*self._changes]
        elif uri.startswith(ENTITY):
            name = unquote(uri.removeprefix(ENTITY))
            try:
                found = await anyio.to_thread.run_sync(
                    self._map.describe, name, limiter=self._limiter
                )
            except Error as error:
                raise MCPError(INVALID_PARAMS, str(error)) from error
        else:
            raise MCPError(INVALID_PARAMS, f"no resource {uri}: {CHANGES}, {ENTITY}NAME")
        text = json.dumps(plain(found), ensure_ascii=False, allow_nan=False)
        contents = TextResourceContents(uri=uri, mime_type=_JSON, text=text)
        return ReadResourceResult(contents=[contents])

    async def _subscribe(self, context: Context, params: SubscribeRequestParams) -> EmptyResult:
        self._subscribed[params.uri] = context.session
        return EmptyResult()

    async def _unsubscribe(self, _: Context, params: UnsubscribeRequestParams) -> EmptyResult:
        self._subscribed.pop(params.uri, None)
        return EmptyResult()


_JSON = "application/json"


def _put(waiting: asyncio.Queue[MapEvent], event: MapEvent) -> None:
    if waiting.full():  # a client that does not read gets the newest
        waiting.get_nowait()
    waiting.put_nowait(event)
