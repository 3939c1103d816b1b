"""A mug behind a box on the kitchen table of the small house: found, found sooner, and moved."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import semmap
from semmap.database import connect
from semmap.ingest.importer import import_file
from tests.command_line import semmap as semmap_command
from tests.conftest import MakeDatabase

ROOMS = Path(__file__).parent / "small_house_rooms.geojson"
TABLE = "KitchenTable_01_001"


@pytest.fixture(scope="module")
def url(make_database: MakeDatabase, worlds: Path) -> str:
    """A database that holds the small house, with a mug behind a box."""
    url = make_database()
    engine = connect(url)
    for path in (worlds / "small_house" / "worlds" / "small_house.world", ROOMS):
        import_file(engine, path, map_name="house")
    engine.dispose()
    text = url.render_as_string(hide_password=False)
    with semmap.connect(text) as database:
        house = database.map("house")
        _, _, top = house.spot(house[TABLE], "on")
        for name, kind, size, y in (
            ("mug", "mug", (0.09, 0.09, 0.1), 1.12),
            ("box", "box", (0.6, 0.1, 0.4), 0.85),
        ):
            house.add_object(name, type=kind, on=TABLE, size=size, pose=(6.3, y, float(top), 0.0))
    return text


def test_a_mug_behind_a_box_is_found_and_found_again_after_it_moved(url: str, tmp_path: Path):
    def search(*more: str) -> tuple[str, int]:
        words = ("--simulate", "--apply", "--speed", 100000, "--from", "bedroom", "--json")
        world = tmp_path / f"{len([*tmp_path.iterdir()])}.sqlite"
        found = semmap_command(
            url, "search", "mug", "--map", "house", *words, "--world", world, *more
        )
        answer = json.loads(found.stdout)
        assert answer["state"] == "done"
        mug = answer["found"]["mug"]
        assert mug["seen"] or mug["looks"] == 0  # it may be sure enough without a look
        looks = [s for s in answer["steps"] if s["action"] == "look"]
        assert len(looks) == mug["looks"]
        return mug["place"], mug["looks"]

    place, first = search()
    assert place == TABLE
    assert first > 1  # from the first side, the box hides it
    place, moved = search("--put", "mug on CoffeeTable_01_001")
    assert place == "CoffeeTable_01_001"
    place, again = search()
    assert place == "CoffeeTable_01_001"
    assert again < moved
