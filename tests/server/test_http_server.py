"""The server bounds its connections, and the time that a request needs to come."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack

import httpx
import pytest

import semmap
from semmap.server import http_server, requests
from tests.served import served


@pytest.fixture
def port(database: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    for module in (http_server, requests):
        monkeypatch.setattr(module, "SECONDS_TO_SEND", 1)
    monkeypatch.setattr(http_server, "MOST_CONNECTIONS", 20)
    with semmap.connect(database) as db, served(db) as url:
        yield httpx.URL(url).port or 0


def opened(port: int, sent: bytes) -> socket.socket:
    found = socket.create_connection(("127.0.0.1", port), timeout=10)
    found.sendall(sent)
    return found


def test_half_a_request_is_not_waited_for(port: int) -> None:
    whole = b"GET /maps HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with opened(port, whole[:20]) as half, opened(port, whole) as again:
        for _ in range(8):  # each byte comes in time, but not the whole
            time.sleep(0.2)
            try:
                half.sendall(b"x")
            except OSError:
                break
        else:
            assert half.recv(100) == b""
        assert b"200 OK" in again.recv(1000)
    with opened(port, whole) as again:  # the second request of a connection
        assert b"200 OK" in again.recv(1000)
        again.sendall(whole[:20])
        while again.recv(100):  # the rest of the answer, then the end
            pass
    head = b"POST /maps/a/find HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n{"
    with opened(port, head) as half:
        assert b" 408 " in half.recv(1000)


def test_a_connection_too_many_is_told_to_try_again(port: int) -> None:
    with ExitStack() as stack:
        for _ in range(20):
            stack.enter_context(opened(port, b""))
        with opened(port, b"") as refused:
            answer = refused.recv(1000)
            assert b" 503 " in answer
            assert b"Retry-After" in answer
    for _ in range(100):
        if httpx.get(f"http://127.0.0.1:{port}/maps").status_code == 200:
            return
        time.sleep(0.05)
    pytest.fail("the places of closed connections are not given back")
