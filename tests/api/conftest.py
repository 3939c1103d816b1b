"""The small house, and an empty database."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import semmap
from tests.conftest import Import
from tests.worlds.conftest import HOUSE, ROOMS


@pytest.fixture
def db(database: str) -> Iterator[semmap.Database]:
    with semmap.connect(database) as opened:
        yield opened


@pytest.fixture(scope="module")
def house(imported: Import, worlds: Path) -> Iterator[semmap.Map]:
    """The small house with its rooms; the tests of a module share it."""
    with imported((worlds / HOUSE, "house"), (ROOMS, "house")) as engine:
        url = engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
        with semmap.connect(url) as opened:
            yield opened.map("house")
