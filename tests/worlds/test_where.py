"""Where things are believed to be in worlds that others made; counts and distances by hand."""

from __future__ import annotations

from collections.abc import Iterator

import psycopg
import pytest
from sqlalchemy import Engine

import semmap
from semmap import Map

KITCHEN, COFFEE, NIGHT = "KitchenTable_01_001", "CoffeeTable_01_001", "NightStand_01_001"


@pytest.fixture(scope="module")
def world_map(house: Engine) -> Iterator[Map]:
    with semmap.connect(house.url.render_as_string(hide_password=False)) as db:
        yield db.map("house")


@pytest.fixture
def here(world_map: Map) -> Iterator[Map]:
    """The small house with a mug, for one test: what the test changes is undone."""
    with world_map.transaction() as transaction:
        world_map.add_object("mug1", type="mug", size=(0.08, 0.08, 0.1))
        yield world_map
        raise psycopg.Rollback(transaction)


@pytest.mark.parametrize(
    ("place", "options", "message"),
    [
        (KITCHEN, {"position": (5000.0, 0.0, 0.8)}, "499[0-9].* m outside of KitchenTable"),
        ("kitchen", {"position": (5000.0, 0.0, 0.8)}, "m outside of kitchen"),
        (KITCHEN, {"hit": 0.1, "false_alarm": 0.2}, "hit, 0.1, is below false_alarm, 0.2"),
    ],
)
def test_impossible_sightings_are_refused(
    here: Map, place: str, options: dict[str, float], message: str
) -> None:
    with pytest.raises(ValueError, match=message), here.transaction():
        here.observe("mug1", place, **options)  # type: ignore[arg-type]
    assert here.execute("SELECT count(*) FROM observation") == [(0,)]


def test_one_thing_is_not_on_two_tables(here: Map) -> None:
    seen = [{"object": "mug1", "place": place} for place in (KITCHEN, COFFEE)]
    on = [{"subject": "mug1", "relation": "on", "object": row["place"]} for row in seen]
    for taught in ({"observations": seen}, {"relations": on}):
        with pytest.raises(ValueError, match="at the same time"), here.transaction():
            here.teach(taught)
    assert here.execute("SELECT count(*) FROM observation") == [(0,)]
