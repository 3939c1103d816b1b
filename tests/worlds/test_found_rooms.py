"""Rooms found in the walls of real worlds, compared with those that their makers drew."""

from __future__ import annotations

from pathlib import Path

import pytest
import shapely

import semmap
from tests.buildings.known_worlds import WORLDS, judge_world, lies_in
from tests.effort import effort
from tests.worlds.conftest import HOUSE

LEAST = {
    "hotel": (0.95, 0.95),
    "clinic": (0.95, 0.92),
    "Duplex": (0.95, 0.95),
    "office": (0.95, 0.95),
    "small_house": (0.95, 0.95),
}
"""The least recall and precision of rooms that walls divide, and of their doors.

Halves of treatment rooms of the clinic, which walls with doorways divide, are counted as wrong."""


@pytest.mark.explore
@pytest.mark.parametrize("world", effort([name for name in WORLDS if name != "clinic"], [*WORLDS]))
def test_rooms_and_doors_of_a_world_are_found_where_walls_divide_them(
    database: str, worlds: Path, world: str
) -> None:
    with semmap.connect(database) as db:
        rooms, doors = judge_world(db, worlds, world)
    assert rooms.known >= 4
    for each in (rooms, doors):
        recall, precision, sure = each.rates[2:]
        assert sure >= 0.9
        assert recall >= LEAST[world][0], each
        assert precision >= LEAST[world][1], each


def test_a_half_of_a_stated_room_and_two_in_one_are_not_more_rooms() -> None:
    """Three sides of a half are at walls, as are all of two rooms together: both are wrong."""
    first, second = shapely.box(0, 0, 4, 4), shapely.box(4.1, 0, 8.1, 4)
    half, both = shapely.box(0, 0, 4, 2), shapely.box(0, 0, 8.1, 4)
    beside = shapely.box(0, 4.1, 3, 7)
    stated = [first, second]
    assert [lies_in(each, stated) for each in (half, both, beside)] == [True, True, False]


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


def test_a_shop_with_a_wall_of_glass_and_a_gate_is_a_room(database: str, worlds: Path) -> None:
    """Its walls by hand: 15.4 by 14.4 m but for a corner; the leaf of the gate is 5.06 m wide."""
    with semmap.connect(database) as db:
        file = worlds / "bookstore" / "worlds" / "bookstore.world"
        db.import_file(file, map="books", find_rooms=True)
        books = db.map("books")
        (room,), (gate,) = books.rooms, books.doors
        corners = [(-7.7, -7.2), (7.7, -7.2), (7.7, 2.25), (2.4, 2.25), (2.4, 7.2), (-7.7, 7.2)]
        shop = shapely.Polygon(corners)
        assert room.footprint.symmetric_difference(shop).area < 0.05 * shop.area
        assert {place and place.name for place in gate.places} == {room.name, None}
        assert gate.width == pytest.approx(5.06, abs=0.1)
        shelf = next(e.name for e in books.objects if e.is_a("bookshelf"))
        assert books.route(room.name, shelf).metres >= 0


def test_a_world_whose_walls_enclose_no_room_comes_in_with_the_reason(
    database: str, tmp_path: Path
) -> None:
    wall = """<model name="wall_{0}"><pose>0 {0} 1.25 0 0 0</pose><link name="l"><collision
      name="c">
      <geometry><box><size>6 0.2 2.5</size></box></geometry></collision></link></model>"""
    file = tmp_path / "lane.sdf"
    walls = "".join(wall.format(y) for y in (0, 4))
    file.write_text(f'<sdf version="1.7"><world name="lane">{walls}</world></sdf>')
    with semmap.connect(database) as db:
        summary = db.import_file(file, map="lane", find_rooms=True)
        assert summary.kinds["object"] == 2
        assert len(db.map("lane").rooms) == 0
        (note,) = (note for note in summary.notes if "found no rooms" in note)
        assert "enclose no room" in note
        assert "draw rooms" in note
