"""Servers with a thread for each connection, of which there are not too many."""

from __future__ import annotations

import resource
import socketserver
import threading
from contextlib import suppress
from typing import Any

MOST_CONNECTIONS = 256
"""The most connections, or a quarter of the files that the process may open."""


class BoundedThreads(socketserver.ThreadingMixIn):
    """A mixin for servers of `socketserver`; `busy` is what a connection too many gets."""

    daemon_threads = True
    block_on_close = False
    busy: bytes

    def __init__(self, *arguments: Any, most: int = MOST_CONNECTIONS) -> None:
        files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]  # -1: unlimited
        self._free = threading.Semaphore(min(most, files % 2**63 // 4))
        super().__init__(*arguments)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer a connection in a thread of its own, or refuse one too many."""
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
            return
        with suppress(OSError):
            request.sendall(self.busy)
        self.shutdown_request(request)  # type: ignore[attr-defined]

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer a connection until it ends."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()
