"""The server: a thread for each connection on a Unix socket, which answers lines of JSON."""

from __future__ import annotations

import json
import socketserver
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from semmap.bounded_threads import BoundedThreads
from semmap.limits import REQUEST_BYTES, REQUEST_SECONDS

SHORT = 2**20
"""Bytes of a request that is read beside others."""

FIRST_SECONDS = 5.0
"""Seconds that a connection has for its first request."""

Answer = Callable[[dict[str, Any]], Iterator[Any]]
"""Yields the replies to a request; mostly one."""


class _Handler(socketserver.StreamRequestHandler):
    server: _Server

    def handle(self) -> None:
        with suppress(OSError):  # the client went away
            self.connection.settimeout(FIRST_SECONDS)
            while line := self._line():
                self.connection.settimeout(None)
                for reply in self._replies(line):
                    self.wfile.write(json.dumps(reply).encode() + b"\n")

    def _line(self) -> bytes:
        """The next request; a long one waits for others, and not long for its rest."""
        line: bytes = self.rfile.readline(SHORT)
        if len(line) < SHORT or line.endswith(b"\n"):
            return line
        with self.server.one_long_request:
            seconds = REQUEST_SECONDS.value
            self.connection.settimeout(seconds)  # it ends the connection
            pieces, ends = [line], time.monotonic() + seconds
            while not pieces[-1].endswith(b"\n"):
                pieces.append(self.rfile.readline(SHORT))
                if REQUEST_BYTES.exceeded_by(len(pieces) * SHORT) or time.monotonic() > ends:
                    return b""
                if not pieces[-1]:
                    return b""
            self.connection.settimeout(None)
            return b"".join(pieces)

    def _replies(self, line: bytes) -> Iterator[dict[str, Any]]:
        try:
            request = json.loads(line)
            if not isinstance(request, dict):
                raise ValueError('a request is an object: {"do": ..., ...}')
            for reply in self.server.answer(request):
                yield {"reply": reply}
        except Exception as error:  # a wrong request ends neither the connection nor the service
            text = error.args[0] if isinstance(error, LookupError) and error.args else error
            yield {"error": str(text) or type(error).__name__}


class _Server(BoundedThreads, socketserver.UnixStreamServer):
    busy = b'{"error": "the service has too many connections: try again"}\n'

    def __init__(self, path: str, answer: Answer) -> None:
        self.answer = answer
        self.one_long_request = threading.Lock()
        super().__init__(path, _Handler)


@contextmanager
def serving(path: Path, answer: Answer) -> Iterator[None]:
    """Answer requests on a socket while the context lasts, or raise OSError.

    A socket that nobody listens on is replaced. `answer` runs in the thread of its connection.
    """
    path.unlink(missing_ok=True)
    with _Server(str(path), answer) as server:
        path.chmod(0o600)
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        try:
            yield
        finally:
            server.shutdown()
            path.unlink(missing_ok=True)
