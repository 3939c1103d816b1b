"""Exports of random buildings and of real worlds come back as the same map."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import semmap
from tests.buildings.building import random_building
from tests.buildings.clouds import scanned
from tests.buildings.judges import stored
from tests.conftest import Import, MakeDatabase
from tests.export.comparison import differences
from tests.worlds.conftest import HOTEL, HOUSE, ROOMS
from tests.worlds.test_duplex import DUPLEX

ENDINGS = [".gpkg", ".geojson", ".sdf", ".gml"]


def come_back(place: semmap.Map, path: Path, **options: Any) -> semmap.Map:
    """The map of an export of a map, in the same database."""
    again = place.database.create_map(f"again {path.name}")
    summary = again.import_file(place.export(path, **options))
    assert summary.skipped == []
    return again


@settings(
    max_examples=2, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(seed=st.integers(0, 10_000))
def test_random_buildings(seed: int, make_database: MakeDatabase, tmp_path_factory) -> None:
    folder = tmp_path_factory.mktemp("building")
    url = make_database().render_as_string(hide_password=False)
    with stored(scanned(random_building(seed)), url, folder) as place:
        for ending in ENDINGS:
            again = come_back(place, folder / f"b{ending}")
            assert differences(place, again) == []


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_flat_with_a_bit_of_everything(
    furnished: semmap.Map, ending: str, tmp_path: Path
) -> None:
    again = come_back(furnished, tmp_path / f"flat{ending}")
    assert differences(furnished, again) == []
    assert {each.kind for each in again.check()} <= {each.kind for each in furnished.check()}


@pytest.mark.parametrize("ending", ENDINGS)
def test_odd_names_come_back(db: semmap.Database, ending: str, tmp_path: Path) -> None:
    """Commas, quotes, slashes, colons, control characters and letters of all scripts."""
    place = db.create_map("odd/map: <&>")
    ground = place.add_storey('1st, "floor"')
    place.add_storey("2nd\u00e9", elevation=3)
    for number, name in enumerate(("a, b", "c/d", "e::f <&>")):
        x = 4 * number
        place.add_room(name, [(x, 0), (x + 3.9, 0), (x + 3.9, 3), (x, 3)], storey=ground)
    place.add_door("d, 1", "a, b", "c/d", ((3.95, 1), (3.95, 2)))
    place.add_door("d\u4e2d", "e::f <&>", None, ((12, 1), (12, 2)))
    for name in ("../up", "x::y", "X__Y", "x__y", "tab\tand\nline", "\x01", "\u4e2d\u6587"):
        x = len(place.objects) + 0.5
        place.add_object(name, size=(0.5, 0.4, 0.3), pose=(x, 1, 0), label='l, <&> "q"')
    again = come_back(place, tmp_path / f"odd{ending}")
    assert differences(place, again) == []
    assert {p.name for p in tmp_path.iterdir()} <= {f"odd{ending}", "odd_meshes"}


@pytest.fixture(scope="module", params=["house", "hotel", "duplex"])
def world(request: pytest.FixtureRequest, imported: Import, worlds: Path) -> Iterator[semmap.Map]:
    name = request.param
    files: list[Any] = {"house": [HOUSE, ROOMS], "hotel": [HOTEL], "duplex": [DUPLEX]}[name]
    with (
        imported(*((worlds / file, name) for file in files)) as engine,
        semmap.connect(engine.url.render_as_string(hide_password=False)) as db,
    ):
        yield db.map(name)


@pytest.mark.parametrize("ending", ENDINGS)
def test_real_worlds(world: semmap.Map, ending: str, tmp_path: Path) -> None:
    again = come_back(world, tmp_path / f"{world.name}{ending}")
    assert differences(world, again) == []
