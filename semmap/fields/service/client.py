"""The client of the service: requests and replies are lines of JSON on a Unix socket."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from semmap.fields.service.endpoint import socket_folder, socket_of


@dataclass(frozen=True)
class ServiceAddress:
    """Where the service of a map is: the `url` of its database, and its name."""

    url: str | None
    map_name: str | None

    def find(
        self, voxel_size: float | None = None
    ) -> AbstractContextManager[ServiceConnection | None]:
        """Connect with the service as `find_service` does."""
        return find_service(self.url, self.map_name, voxel_size)

    def socket(self, map_name: str) -> Path:
        """Return the socket for a map of the database, as `socket_of` does."""
        return socket_of(self.url, map_name)


class ServiceConnection:
    """A connection with the service of the map `map_name`."""

    def __init__(self, stream: Any, channel: socket.socket, map_name: str = "") -> None:
        self._stream, self._channel = stream, channel
        self._closed = False
        self.map_name = map_name

    def _next_line(self) -> bytes:
        try:
            return bytes(self._stream.readline())
        except (OSError, ValueError):
            if not self._closed:
                raise
            return b""

    def close(self) -> None:
        """End the connection, and loops over `replies` in other threads."""
        self._closed = True
        with suppress(OSError):
            self._channel.shutdown(socket.SHUT_RDWR)

    def ask(self, action: str, **arguments: Any) -> Any:
        """Return the reply to a request, or raise ValueError (refused) or ConnectionError."""
        self.send(action, **arguments)
        for reply in self.replies():
            return reply
        raise ConnectionError("the service ended before it replied: start it again")

    def send(self, action: str, **arguments: Any) -> None:
        """Send a request."""
        self._stream.write(json.dumps({"do": action} | arguments).encode() + b"\n")
        self._stream.flush()

    def replies(self) -> Iterator[Any]:
        """Yield replies until the service ends, or this connection is closed."""
        while line := self._next_line():
            reply = json.loads(line)
            if "error" in reply:
                raise ValueError(str(reply["error"]))
            yield reply["reply"]


@contextmanager
def find_service(
    url: str | None, map_name: str | None, voxel_size: float | None = None
) -> Iterator[ServiceConnection | None]:
    """Connect with the service of a map, or give None if none is running.

    Without a map, it is that which commands use; with `voxel_size`, metres, only such a service
    counts.
    """
    folder = socket_folder(url)
    paths = sorted(folder.glob("*.sock")) if folder.is_dir() else []
    for path in paths:
        with socket.socket(socket.AF_UNIX) as channel:
            try:
                channel.connect(str(path))
            except OSError:
                continue  # left behind by a service that was killed
            with channel.makefile("rwb") as stream:
                found = ServiceConnection(stream, channel)
                hello = found.ask("hello", map=map_name)
                same = voxel_size is None or abs(hello["voxel_size"] - voxel_size) < 1e-9
                if hello["is_meant"] and same:
                    found.map_name = hello["map"]
                    try:
                        yield found
                    finally:
                        found.close()  # a thread that waits for a reply would keep the stream open
                    return
    yield None
