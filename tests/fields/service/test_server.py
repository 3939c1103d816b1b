"""The socket of fields under clients that send too much, or never end a line."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from semmap.fields.service import client as client_module
from semmap.fields.service import server
from semmap.fields.service.client import find_service
from semmap.fields.service.server import serving


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("SEMMAP_MAX_REQUEST_SECONDS", "1")
    monkeypatch.setenv("SEMMAP_MAX_REQUEST_BYTES", "4194304")

    def answer(request: dict[str, Any]) -> Iterator[Any]:
        yield len(request["text"])

    with serving(tmp_path / "s", answer):
        yield tmp_path / "s"


def client(path: Path) -> socket.socket:
    made = socket.socket(socket.AF_UNIX)
    made.settimeout(10)
    made.connect(str(path))
    return made


def asked(path: Path, length: int) -> Any:
    with client(path) as one:
        one.sendall(json.dumps({"text": "x" * length}).encode() + b"\n")
        return json.loads(one.makefile().readline())


def test_long_requests_are_answered(path: Path) -> None:
    for length in (0, server.SHORT - 12, server.SHORT, 3 * server.SHORT):
        assert asked(path, length) == {"reply": length}


def test_a_line_beyond_the_limit_ends_its_connection(path: Path) -> None:
    with client(path) as one, pytest.raises(OSError):  # noqa: PT011
        one.sendall(bytes(2**26))
    assert asked(path, 5) == {"reply": 5}


def test_unfinished_lines_hold_one_request_and_not_for_long(path: Path) -> None:
    held = [client(path) for _ in range(5)]
    for one in held:
        one.sendall(b"x" * (server.SHORT + 10))
    began = time.monotonic()
    assert asked(path, 5) == {"reply": 5}
    assert time.monotonic() - began < 0.9, "a short request waits for none of them"
    assert asked(path, 2 * server.SHORT) == {"reply": 2 * server.SHORT}
    assert 3 < time.monotonic() - began < 8, "a long one waits, each of them for a second"
    for one in held:
        assert one.recv(1) == b""
        one.close()


def test_a_service_that_ends_is_not_running(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client_module, "socket_folder", lambda url: tmp_path)
    with socket.socket(socket.AF_UNIX) as service:
        service.bind(str(tmp_path / "a.sock"))
        service.listen()

        def end() -> None:
            one, _ = service.accept()
            one.recv(1)  # closed with bytes that it did not read, it resets the connection
            one.close()

        thread = threading.Thread(target=end)
        thread.start()
        with find_service(None, None) as found:
            assert found is None
        thread.join()
