"""What a map says of random buildings agrees with independent judges."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import semmap
from tests.buildings.building import Building, random_building
from tests.buildings.clouds import scanned
from tests.buildings.judges import JUDGES, Judge, stored
from tests.conftest import MakeDatabase
from tests.effort import effort

SEEDS = effort([152, 176], range(4))
"""In each run, two small buildings with scans, stairs and a lift, in one of which a TIAGo acts."""


@pytest.fixture(scope="module", params=SEEDS)
def known(
    request: pytest.FixtureRequest,
    make_database: MakeDatabase,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[Building, semmap.Map]]:
    """A random building, and the map that holds it."""
    building = scanned(random_building(request.param))
    url = make_database().render_as_string(hide_password=False)
    with stored(building, url, tmp_path_factory.mktemp("building")) as place:
        yield building, place


@pytest.mark.explore
@pytest.mark.parametrize("judge", JUDGES, ids=lambda judge: judge.__name__)
def test_the_map_agrees_with(judge: Judge, known: tuple[Building, semmap.Map]) -> None:
    asked, wrong = judge(*known)
    assert wrong == []
    assert asked > 0
