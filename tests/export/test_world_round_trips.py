"""Exports of real worlds come back as the same map."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import semmap
from tests.conftest import Import
from tests.effort import effort
from tests.export.comparison import Picture, differences
from tests.export.test_round_trips import ENDINGS, come_back
from tests.worlds.conftest import CLINIC, HOTEL, HOUSE, ROOMS
from tests.worlds.test_duplex import DUPLEX


@pytest.fixture(
    scope="module",
    params=effort(["house", "hotel", "duplex"], ["house", "hotel", "clinic", "duplex"]),
)
def world(
    request: pytest.FixtureRequest, imported: Import, worlds: Path
) -> Iterator[tuple[semmap.Map, Picture]]:
    name = request.param
    files: list[Any] = {
        "house": [HOUSE, ROOMS],
        "hotel": [HOTEL],
        "clinic": [CLINIC],
        "duplex": [DUPLEX],
    }[name]
    with (
        imported(*((worlds / file, name) for file in files)) as engine,
        semmap.connect(engine.url.render_as_string(hide_password=False)) as db,
    ):
        yield db.map(name), Picture.of(db.map(name))


@pytest.mark.explore
@pytest.mark.parametrize("ending", ENDINGS)
def test_real_worlds(world: tuple[semmap.Map, Picture], ending: str, tmp_path: Path) -> None:
    place, picture = world
    again = come_back(place, tmp_path / f"{place.name}{ending}")
    assert differences(picture, again) == []
