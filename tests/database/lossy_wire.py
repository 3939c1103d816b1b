"""A wire between a client and a server of PostgreSQL that breaks when a commit is sent."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Literal

from sqlalchemy import URL, make_url

Loss = Literal["request", "answer"]
"""What is lost: the commit, which the server never sees, or only what it answers."""


class LossyWire:
    """Listens at `port` of 127.0.0.1; `lose` what the next commits are about, then nothing."""

    def __init__(self, server: URL) -> None:
        self._server = server
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._socket.getsockname()[1]
        self.lose: list[Loss] = []
        self.lost = 0
        self._threads: list[threading.Thread] = []

    def start(self) -> None:
        """Begin to carry bytes."""
        self._start(self.run)

    def url(self, url: str) -> str:
        """The URL of a database through this wire."""
        through = make_url(url).set(drivername="postgresql", host="127.0.0.1", port=self.port)
        return through.difference_update_query(["host", "port"]).render_as_string(
            hide_password=False
        )

    def run(self) -> None:
        """Carry bytes until `close`."""
        with suppress(OSError):
            while True:
                client, _ = self._socket.accept()
                self._start(self._carry, client)

    def close(self) -> None:
        """Listen no longer."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()

    def join(self) -> None:
        """Wait until all connections have ended."""
        while self._threads:
            self._threads.pop().join()

    def _start(self, function: Callable[..., None], *args: Any) -> None:
        self._threads.append(threading.Thread(target=function, args=args, daemon=True))
        self._threads[-1].start()

    def _reach(self) -> socket.socket:
        host = str(self._server.query.get("host", self._server.host))
        port = int(str(self._server.query.get("port", self._server.port or 5432)))
        if host.startswith("/"):
            made = socket.socket(socket.AF_UNIX)
            made.connect(f"{host}/.s.PGSQL.{port}")
            return made
        return socket.create_connection((host, port))

    def _carry(self, client: socket.socket) -> None:
        over = threading.Event()
        with client, self._reach() as server:
            back = threading.Thread(target=self._answer, args=(client, server, over))
            back.start()
            with suppress(OSError):
                while data := client.recv(1 << 16):
                    if self.lose and b"COMMIT" in data:
                        self.lost += 1
                        if self.lose.pop(0) == "request":
                            break
                        over.set()
                    server.sendall(data)
            if not over.is_set():
                hang_up(client, server)
            back.join()

    def _answer(self, client: socket.socket, server: socket.socket, over: threading.Event) -> None:
        with suppress(OSError):
            while (data := server.recv(1 << 16)) and not over.is_set():
                client.sendall(data)
        hang_up(client, server)  # `over`: the server has answered, so that what it did is done


def hang_up(*sockets: socket.socket) -> None:
    """Let both ends of connections see that they ended."""
    for each in sockets:
        with suppress(OSError):
            each.shutdown(socket.SHUT_RDWR)


@contextmanager
def lossy_wire(server: URL) -> Iterator[LossyWire]:
    """A wire to a server, while a ``with`` block lasts."""
    wire = LossyWire(server)
    wire.start()
    try:
        yield wire
    finally:
        wire.close()
        wire.join()
