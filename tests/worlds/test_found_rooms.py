"""Rooms found in the walls of real worlds, compared with those that their makers drew."""

from __future__ import annotations

from pathlib import Path

import pytest

import semmap
from tests.buildings.known_worlds import WORLDS, judge_world
from tests.worlds.conftest import HOUSE

LEAST = {"hotel": 0.95, "clinic": 0.9, "Duplex": 0.95, "office": 0.95, "small_house": 0.95}
"""The least recall and precision of rooms that walls divide, and of their doors."""


@pytest.mark.parametrize("world", WORLDS)
def test_rooms_and_doors_of_a_world_are_found_where_walls_divide_them(
    database: str, worlds: Path, world: str
) -> None:
    with semmap.connect(database) as db:
        rooms, doors = judge_world(db, worlds, world)
    assert rooms.known >= 4
    assert min(rooms.rates[2:] + doors.rates[2:]) >= LEAST[world], (rooms, doors)


def test_a_furnished_world_without_rooms_gets_rooms_types_and_routes(
    database: str, worlds: Path
) -> None:
    with semmap.connect(database) as db:
        house = db.create_map("bare_house")
        house.import_file(worlds / HOUSE)
        assert len(house.rooms) == 0

        house.find_rooms(add=True)

        types = {room.type: room for room in house.rooms}
        assert set(types) == {"balcony", "bedroom", "kitchen"}
        assert house["Bed_01_001"].room == types["bedroom"]
        assert house["Refrigerator_01_001"].room == types["kitchen"]
        assert "Bed_01_001" in types["bedroom"].properties["found"]["shown_by"]
        assert house.route(types["balcony"].name, types["bedroom"].name).metres > 5
        (again,) = house.find_rooms(add=True)
        assert (again.rooms, again.doorways, len(again.known)) == ((), (), 3)

        types["bedroom"].name = "our bedroom"
        (again,) = house.find_rooms(add=True)
        assert again.rooms == ()
        assert "our bedroom" in again.known


def test_a_world_whose_walls_enclose_no_room_comes_in_with_the_reason(
    database: str, worlds: Path
) -> None:
    with semmap.connect(database) as db:
        file = worlds / "bookstore" / "worlds" / "bookstore.world"
        summary = db.import_file(file, map="books", find_rooms=True)
        assert summary.kinds["object"] > 100
        assert len(db.map("books").rooms) == 0
        (note,) = (note for note in summary.notes if "found no rooms" in note)
        assert "enclose no room" in note
        assert "draw rooms" in note
