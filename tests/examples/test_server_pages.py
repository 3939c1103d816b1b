"""The clients of docs/tools.md and docs/http.md find a cup, and the way to it."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from sqlalchemy import Engine

from tests.examples.test_api_page import BLOCK, ROOT

SEMMAP = Path(sys.executable).with_name("semmap")


@pytest.fixture
def surroundings(office_world: Engine) -> dict[str, str]:
    """The environment of a user of the office."""
    programs = f"{SEMMAP.parent}{os.pathsep}{os.environ['PATH']}"
    url = office_world.url.render_as_string(hide_password=False)
    return os.environ | {"SEMMAP_DB": url, "PATH": programs}


def printed(page: str, surroundings: dict[str, str]) -> list[str]:
    """What the example of a page prints."""
    (example,) = BLOCK.findall((ROOT / page).read_text())
    told = subprocess.run(
        [sys.executable, "-c", example],
        env=surroundings,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert told.returncode == 0, told.stderr
    return told.stdout.split()


def test_the_client_of_tools_gets_answers(surroundings: dict[str, str]) -> None:
    words = printed("docs/tools.md", surroundings)
    assert words[0].startswith("cup")
    assert float(words[-1]) > 0


def test_the_client_of_http_gets_answers(surroundings: dict[str, str]) -> None:
    with serving(surroundings):
        cup, seconds, rooms = printed("docs/http.md", surroundings)
    assert cup.startswith("cup")
    assert float(seconds) > 0
    assert int(rooms) == 17


@contextmanager
def serving(surroundings: dict[str, str]) -> Iterator[None]:
    """Run `semmap serve` until the block ends."""
    with subprocess.Popen([SEMMAP, "serve"], env=surroundings, stderr=subprocess.PIPE) as server:
        try:
            for _ in range(300):
                try:
                    httpx.get("http://127.0.0.1:8890/maps")
                    break
                except httpx.TransportError:
                    assert server.poll() is None, server.communicate()
                    time.sleep(0.1)
            yield
        finally:
            server.terminate()
