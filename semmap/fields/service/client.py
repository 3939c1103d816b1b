"""The client of the service: requests and replies are lines of JSON on a Unix socket.

A service has one socket for each map, for its user alone. This module loads nothing that is slow,
so that a command that asks a service is quick.
"""

from __future__ import annotations

import hashlib
import json
import os
import socket
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, quote, unquote, urlsplit

from semmap.data_folder import default_home
from semmap.temporary_folder import temporary_parent

if TYPE_CHECKING:
    import psycopg


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
        with suppress(OSError):  # a service that refuses a connection says why before it reads
            self.send(action, **arguments)
        for reply in self.replies():
            return reply
        raise ConnectionError("the service ended before it replied: start it again")

    def send(self, action: str, **arguments: Any) -> None:
        """Send a request."""
        self._channel.sendall(json.dumps({"do": action} | arguments).encode() + b"\n")

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
            with channel.makefile("rb") as stream:
                found = ServiceConnection(stream, channel)
                try:
                    hello = found.ask("hello", map=map_name)
                except OSError:
                    continue  # its service ends now
                same = voxel_size is None or abs(hello["voxel_size"] - voxel_size) < 1e-9
                if hello["is_meant"] and same:
                    found.map_name = hello["map"]
                    try:
                        yield found
                    finally:
                        found.close()  # a thread that waits for a reply would keep the stream open
                    return
    yield None


def url_of(session: psycopg.Connection[Any]) -> str:
    """Return a URL, without login, of the database that a session is connected with."""
    info = session.info
    host = quote(info.host, safe="")
    return f"postgresql:///{quote(info.dbname, safe='')}?host={host}&port={info.port}"


def socket_folder(url: str | None) -> Path:
    """Return the folder of the sockets for a database, by its URL; it may not exist."""
    key = hashlib.sha256("\0".join(_identity(url)).encode()).hexdigest()[:12]
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime.startswith("/") and len(runtime) < 40:
        return Path(runtime) / "semmap-fields" / key
    return temporary_parent() / f"semmap-fields-{os.getuid()}" / key


def socket_of(url: str | None, map_name: str) -> Path:
    """Return the socket for a map, in a folder that only this user can enter, or raise OSError."""
    folder = socket_folder(url)
    for each in (folder.parent, folder):
        each.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = each.lstat()
        own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
        if not own or found.st_mode & 0o077:
            raise PermissionError(
                f"{each} is not a folder that only you can enter: remove it and call again"
            )
    return folder / f"{hashlib.sha256(map_name.encode()).hexdigest()[:16]}.sock"


def _identity(url: str | None) -> tuple[str, str, str]:
    """Return host, port and name of a database."""
    given = url or os.environ.get("SEMMAP_DB")
    if not given:
        return str(default_home() / "run"), "5432", "semmap"
    parts = urlsplit(given)
    options = parse_qs(parts.query)
    host = options.get("host", [parts.hostname or "localhost"])[0]
    port = options.get("port", [str(parts.port or 5432)])[0]
    return unquote(host), port, unquote(parts.path.lstrip("/"))
