"""The server of the HTTP API."""

from __future__ import annotations

import asyncio
import resource
import socket
import sys
from collections.abc import Callable

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from semmap.server.http_api import HttpApi
from semmap.server.requests import SECONDS_TO_SEND

PATIENCE = 5
"""Seconds that requests have to end when the server stops."""

MOST_CONNECTIONS = 512
"""The most connections, or half of the files that the process may open."""

BACKLOG = 128
"""The most connections, or an eighth of the files, that are accepted before one is refused.

Where none can be opened, asyncio writes an error for each, and accepts none for a second.
"""

_BUSY = (
    b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 1\r\nConnection: close\r\n"
    b"Content-Length: 0\r\n\r\n"
)


def _most_files() -> int:
    soft = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return sys.maxsize if soft == resource.RLIM_INFINITY else soft


class BoundedProtocol(H11Protocol):
    """A connection that is closed where there are too many, or the head of a request comes late."""

    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Refuse a connection beyond the limit."""
        super().connection_made(transport)
        if len(self.connections) > min(MOST_CONNECTIONS, _most_files() // 2):
            transport.write(_BUSY)
            transport.close()
        self._expect_head()

    def data_received(self, data: bytes) -> None:
        """Read on; the whole head of a request has to come in time."""
        if self._late is None and self.conn.their_state is h11.IDLE:
            self._expect_head()
        super().data_received(data)
        if self._late is not None and self.conn.their_state is not h11.IDLE:
            self._late.cancel()
            self._late = None

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        super().connection_lost(exc)
        if self._late is not None:
            self._late.cancel()

    def _expect_head(self) -> None:
        self._late = self.loop.call_later(SECONDS_TO_SEND, self.transport.close)


class HttpServer(uvicorn.Server):
    """Answers requests of an API until `should_exit`.

    `begun` is called with the port when it listens; 0 chooses a free one.
    """

    def __init__(
        self, api: HttpApi, host: str, port: int, begun: Callable[[int], object] = lambda _: None
    ) -> None:
        super().__init__(
            uvicorn.Config(
                api.app,
                host=host,
                port=port,
                http=BoundedProtocol,
                backlog=min(BACKLOG, _most_files() // 8),
                log_level="warning",
                timeout_graceful_shutdown=PATIENCE,
            )
        )
        self._api, self._begun = api, begun

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listen; SystemExit where the address cannot be used."""
        await super().startup(sockets)
        self._begun(self.port)

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self.servers[0].sockets[0].getsockname()[1])

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Let go of those who follow the changes, then of all others."""
        self._api.end_streams()
        await super().shutdown(sockets)
