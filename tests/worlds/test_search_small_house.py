"""A mug behind a box on the kitchen table of the small house: found, found sooner, and moved."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from sqlalchemy import Engine

import semmap
from tests.command_line import semmap as semmap_command
from tests.worlds.conftest import store_slim_robot

TABLE = "KitchenTable_01_001"


@pytest.fixture(scope="module")
def url(house: Engine) -> str:
    """A database that holds the small house, with a mug behind a box."""
    text = house.url.render_as_string(hide_password=False)
    with semmap.connect(text) as database:
        home = database.map("house")
        _, _, top = home.spot(home[TABLE], "on")
        for name, kind, size, y in (
            ("mug", "mug", (0.09, 0.09, 0.1), 1.12),
            ("box", "box", (0.6, 0.1, 0.4), 0.85),
        ):
            home.add_object(name, type=kind, on=TABLE, size=size, pose=(6.3, y, float(top), 0.0))
    store_slim_robot(house)
    return text


def test_a_mug_behind_a_box_is_found_and_found_again_after_it_moved(url: str, tmp_path: Path):
    def search(*more: str) -> tuple[str, int]:
        words = ("--simulate", "--apply", "--speed", 100000, "--from", "bedroom", "--json")
        words += ("--robot", "slim")
        world = tmp_path / f"{len([*tmp_path.iterdir()])}.sqlite"
        found = semmap_command(
            url, "search", "mug", "--map", "house", *words, "--world", world, *more
        )
        answer = json.loads(found.stdout)
        assert answer["state"] == "done"
        assert "not_found" not in answer
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
