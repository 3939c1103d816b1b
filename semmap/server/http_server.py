"""The server of the HTTP API."""

from __future__ import annotations

import socket
from collections.abc import Callable

import uvicorn

from semmap.server.http_api import HttpApi

PATIENCE = 5
"""Seconds that requests have to end when the server stops."""


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
