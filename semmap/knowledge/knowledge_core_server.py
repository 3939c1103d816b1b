"""The network protocol of KnowledgeCore, whose clients, such as pykb, speak to a map by it.

A message has lines and ends with ``#end#``. A request is a method and its arguments as JSON, of
which the last may be ``{"kwargs": {...}}``. An answer is ``ok`` and a value, or ``error``, a class
and a reason; an ``event`` has the number of its subscription and a list of bindings.
"""

from __future__ import annotations

import inspect
import json
import re
import socket
import socketserver
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

from semmap.bounded_threads import BoundedThreads
from semmap.error import InvalidArgumentError
from semmap.knowledge.client import KnowledgeClient
from semmap.knowledge.knowledge_core import KB, KbError, Models
from semmap.limits import MESSAGE_BYTES, MESSAGE_SECONDS
from semmap.plain_values import plain
from semmap.query.map_handle import MapSource

PORT = 6969
"""Where KnowledgeCore listens."""

MOST_CONNECTIONS = 64

CALLS_AT_ONCE = 8
"""The most calls in progress; each has a connection to the database."""

END = b"#end#"

_STRING = re.compile(rb'(?:[^"\\\n]|\\.)*')
"""The rest of a string, in which ``#end#`` is text."""

_NEXT = re.compile(rb'"|#end#')
"""What begins a string or ends a message."""


def labels(kb: KB, term: str, models: Models = None) -> dict[str, str]:
    """Return the labels of a term by language."""
    return kb.labels(term, models)


def subscribe(kb: KB, patterns: Any, one_shot: bool = False, models: Models = None) -> str:
    """Return the number of a subscription, whose events are sent."""
    return kb.subscribe(patterns, one_shot=one_shot, models=models)


METHODS: dict[str, Callable[..., Any]] = {
    name: method
    for name, method in inspect.getmembers(KB, inspect.isfunction)
    if not name.startswith("_")
} | {"label": labels, "subscribe": subscribe}
"""What clients may call: methods of a `KB`, of which two differ over the network."""

NAMES = {
    ("details", "resource"): "term",
    ("lookup", "resource"): "query",
    ("sparql", "model"): "models",
}
"""Names of arguments that are those of a `KB` elsewhere."""


class Scan:
    """Looks for the end of a message that comes in pieces, each of which is read once."""

    def __init__(self) -> None:
        self._at, self._in_string = 0, False

    def end_in(self, buffer: bytearray) -> int | None:
        """Return where the message ends; None where its end has not come."""
        while True:
            if self._in_string:
                rest = _STRING.match(buffer, self._at)
                self._at = self._at if rest is None else rest.end()
                if bytes(buffer[self._at : self._at + 2]) in (b"", b"\\"):
                    return None  # the rest comes with the next piece
                self._at, self._in_string = self._at + 1, False
            found = _NEXT.search(buffer, self._at)
            if found is None:
                self._at = max(self._at, len(buffer) - len(END) + 1)
                return None
            if found[0] == END:
                return found.start()
            self._at, self._in_string = found.end(), True


class KnowledgeCoreServer(BoundedThreads, socketserver.TCPServer):
    """Answers the clients of KnowledgeCore on a map, each with subscriptions of its own.

    They act with the rights of the database's role. RDF files are read from the folder `files`.
    """

    allow_reuse_address = True
    request_queue_size = MOST_CONNECTIONS
    busy = b"error\nkberror\nthe server has too many connections: try again\n#end#\n"

    def __init__(self, client: KnowledgeClient, host: str, port: int, files: Path | None) -> None:
        self.client, self.files = client, files
        self.connections: set[socket.socket] = set()
        self.calls = threading.Semaphore(CALLS_AT_ONCE)
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        super().__init__((host, port), _Connection, most=MOST_CONNECTIONS)

    def close(self) -> None:
        """Listen no more, and end the connections."""
        self.shutdown()
        self.server_close()
        for connection in [*self.connections]:
            with suppress(OSError):  # it has ended
                connection.shutdown(socket.SHUT_RDWR)


class _Connection(socketserver.BaseRequestHandler):
    server: KnowledgeCoreServer
    request: socket.socket

    def handle(self) -> None:
        """Answer requests until the client leaves, or what it sends cannot be a request."""
        self.request.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self.request.settimeout(MESSAGE_SECONDS.value)
        self._sending = threading.RLock()
        self.server.connections.add(self.request)
        with KB(self.server.client) as self._kb:
            events = threading.Thread(target=self._send_events, daemon=True)
            events.start()
            try:
                with suppress(OSError):  # the client went away
                    self._answer_requests()
            finally:
                self._kb.events.put(("", []))
                events.join()
                self.server.connections.discard(self.request)

    def _answer_requests(self) -> None:
        for message in self._messages():
            name, *arguments = message.strip().split(b"\n")
            # A subscription's events come after its number.
            with self._sending if name == b"subscribe" else nullcontext():
                self._send(self._answer(name, arguments))
            if name == b"close" or not re.fullmatch(rb"\w+", name):
                return  # a page of the web may send HTTP, with requests in it

    def _messages(self) -> Iterator[bytes]:
        """Yield messages without their end; the first one, and each that began, comes in time."""
        buffer, scan, began, first = bytearray(), Scan(), time.monotonic(), True
        while True:
            try:
                piece = self.request.recv(2**16)
            except TimeoutError:
                if first or buffer.strip():
                    raise
                continue
            if not piece:
                return
            if not first and not buffer.strip():
                began = time.monotonic()
            buffer += piece
            while (end := scan.end_in(buffer)) is not None:
                yield bytes(buffer[:end])
                del buffer[: end + len(END)]
                scan, first, began = Scan(), False, time.monotonic()
            if MESSAGE_BYTES.exceeded_by(len(buffer)):
                most = MESSAGE_BYTES.text(MESSAGE_BYTES.value)
                reason = f"the message has more than {most}: send parts of it, or raise the limit"
                self._send(_error(f"{reason} by {MESSAGE_BYTES.variable}"))
                return
            if MESSAGE_SECONDS.exceeded_by(time.monotonic() - began):
                self._send(_error("the message took too long"))
                return

    def _answer(self, name: bytes, arguments: list[bytes]) -> str:
        try:
            value = self._call(name.decode(), *_parsed(arguments))
        except Exception as error:  # a wrong request ends neither the connection nor the server
            return _error(_reason(error))
        return "ok\n" if value is None else f"ok\n{_json(value)}\n"

    def _call(self, name: str, arguments: list[Any], named: dict[str, Any]) -> Any:
        if name == "close":
            return None
        if name == "methods":
            return [f"{each}{_signature(method)}" for each, method in METHODS.items()]
        named = {NAMES.get((name, key), key): value for key, value in named.items()}
        method = METHODS.get(name)
        if method is None:
            raise KbError(f"there is no method {name!r}; methods: {', '.join(METHODS)}")
        try:
            bound = _signature(method).bind(*arguments, **named)
        except TypeError as error:
            raise KbError(f"{name}{_signature(method)}: {error}") from error
        if name == "load":
            bound.arguments["filename"] = self._file(bound.arguments["filename"])
        with self.server.calls:
            return method(self._kb, *bound.args, **bound.kwargs)

    def _file(self, name: Any) -> Path:
        """Return a file that clients may have read."""
        folder = self.server.files
        if folder is None:
            raise KbError("files are not read: start the server with a folder of them (--files)")
        path = (folder / str(name)).resolve()
        if not path.is_relative_to(folder.resolve()):
            raise KbError(f"{name} is not in the folder of the server's files: copy it there")
        return path

    def _send_events(self) -> None:
        try:
            while True:
                number, bindings = self._kb.events.get()
                if not number:
                    return
                self._send(f"event\n{number}\n{_json(bindings)}\n")
        except Exception:  # a client that gets no more events is told so by the end
            with suppress(OSError):
                self.request.shutdown(socket.SHUT_RDWR)

    def _send(self, text: str) -> None:
        with self._sending:
            try:
                self.request.sendall(text.encode(errors="replace") + END + b"\n")
            except OSError:  # the client does not read, or went away: the loop of requests ends
                with suppress(OSError):
                    self.request.shutdown(socket.SHUT_RDWR)
                raise


def _signature(method: Callable[..., Any]) -> inspect.Signature:
    signature = inspect.signature(method)
    return signature.replace(parameters=[*signature.parameters.values()][1:])


def _parsed(lines: list[bytes]) -> tuple[list[Any], dict[str, Any]]:
    """Return the arguments of lines of JSON, and those with names."""
    arguments = []
    for line in filter(None, map(bytes.strip, lines)):
        try:
            arguments.append(json.loads(line))
        except (ValueError, RecursionError) as error:
            raise KbError(f"{line[:100].decode(errors='replace')}: is not JSON: {error}") from error
    named = arguments[-1] if arguments else None
    if isinstance(named, dict) and isinstance(named.get("kwargs"), dict):
        return arguments[:-1], named["kwargs"]
    return arguments, {}


def _json(value: Any) -> str:
    return json.dumps(plain(value)).replace("#end#", "\\u0023end#")


def _error(reason: str) -> str:
    return f"error\nkberror\n{' '.join(reason.split()).replace('#end#', '# end#')}\n"


def _reason(error: Exception) -> str:
    return str(error) if isinstance(error, KbError) else f"{type(error).__name__}: {error}"


@contextmanager
def serving(
    source: MapSource, host: str = "127.0.0.1", port: int = PORT, files: Path | None = None
) -> Iterator[int]:
    """Answer the clients of KnowledgeCore while the context lasts; yields the port, 0 chooses one.

    InvalidArgumentError where the address cannot be used.
    """
    with KnowledgeClient(source) as client, listening(client, host, port, files) as chosen:
        yield chosen


@contextmanager
def listening(
    client: KnowledgeClient, host: str = "127.0.0.1", port: int = 0, files: Path | None = None
) -> Iterator[int]:
    """As `serving`, by a client that is there."""
    try:
        server = KnowledgeCoreServer(client, host, port, files)
    except (OSError, OverflowError) as error:
        raise InvalidArgumentError(
            f"{host}:{port} cannot be used ({error}): choose another port or host"
        ) from error
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    try:
        yield server.server_address[1]
    finally:
        server.close()
